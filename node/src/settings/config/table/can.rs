//! The entries of the parameter table for a CAN bus.

use super::Mutability::Never;
use super::{Parameter, ParameterKind};
use crate::settings::config::Value;

/// The parameters.
pub(super) const CAN: [Parameter; 6] = [
    text!(
        "can.interface",
        ParameterKind::Text,
        Never,
        "interface to a CAN bus, e.g. can0, or file:LOG[,bus=NAME][,out=LOG], which plays a log in real time; empty: no bus",
        can.interface
    ),
    list!("can.dbc", "DBC files that describe the messages of the bus", can.dbc),
    list!(
        "can.map",
        "inputs that are read from the bus, each with its signal, e.g. ['displacement=SUSP_FL.Position,sign=-1']; options are sign, offset \
         and unit, as in --map of the commands that read runs",
        can.map
    ),
    list!(
        "can.check",
        "messages of inputs whose alive counter and checksum are checked, e.g. ['SUSP_FL,counter=Alive,checksum=Crc,data_id=291']; with \
         data_id by AUTOSAR E2E profile 1, without it CRC-8 SAE J1850",
        can.check
    ),
    list!(
        "can.out",
        "outputs that are sent to the bus, each with message and signals, e.g. ['force_estimate=DAMPER_FL,force=Force,validity=Validity', \
         'current_command=COIL_FL,current=Demand,counter=Alive,checksum=Crc,data_id=291']; empty: nothing is sent",
        can.out
    ),
    double!(
        "can.period_s",
        0.0..=10.0,
        Never,
        "shortest time between two frames of one output, s; the newest value is sent",
        can.period_s
    ),
];
