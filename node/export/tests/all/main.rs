//! The exported C code computes the service's bits.

mod a2l;
mod arithmetic;
mod back_to_back;
mod cases;
mod compile;
mod cortex;
mod cppcheck;
mod fmpy;
mod fmu;
mod inverse;
mod requirements;
mod single;
