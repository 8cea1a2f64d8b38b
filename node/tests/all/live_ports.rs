//! The ports that a participant takes, as the machine sees them.

use crate::domain::Domain;
use crate::live_support::{Caller, config};
use crate::turn::turn;
use std::net::{Ipv4Addr, UdpSocket};

#[test]
fn a_participant_passes_over_an_id_whose_port_of_user_data_is_taken() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let bind = |offset: u16| UdpSocket::bind((Ipv4Addr::UNSPECIFIED, domain.port(offset)));
    let taken = [11, 15].map(|offset| bind(offset).expect("nobody else is in the domain"));

    let first = Caller::new(&config(domain.id()));
    let second = Caller::new(&config(domain.id()));
    // Ids 0 and 2 are incomplete, so the participants have 1 and 3: two ports each.
    let free: Vec<u16> = (10..20).filter(|offset| bind(*offset).is_ok()).collect();
    assert_eq!(free, [10, 14, 18, 19]);

    first.stop();
    second.stop();
    drop(taken);
}
