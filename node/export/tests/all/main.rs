//! The exported C code computes the service's bits.

mod back_to_back;
mod cases;
mod compile;
mod cortex;
mod fmu;
mod inverse;
