//! What a slot costs beside what the wire alone takes: the driver's whole transaction against an emulator that answers at
//! once, over the time budget of the profile. Prints median, 99th percentile and their ratio to the budget.

use std::path::Path;
use std::sync::Arc;

use hil::rig::emulator::{Emulator, Faults, Listen, Listening, Load};
use hil::rig::profile::{Profile, TransportKind};
use hil::rig::wire::open_device;
use hil::rig::{Endpoint, Quality, realtime};

const SLOTS: usize = 3000;

fn main() {
    realtime::prepare(50);
    println!("{:<22} {:>10} {:>10} {:>10} {:>14} {:>14}", "profile", "median us", "99 % us", "wire us", "median / wire", "99 % / wire");
    for name in ["emulator", "emulator-tcp", "emulator-line"] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("drivers/{name}.toml"));
        let profile = Profile::load(&path).expect("a shipped profile");
        let listen = match profile.transport.kind {
            TransportKind::Tcp | TransportKind::TcpGateway => Listen::Tcp(([127, 0, 0, 1], 0).into()),
            _ => Listen::Pty(None),
        };
        let emulator =
            Emulator::start(Arc::new(profile.clone()), Load::RequestNumber, &listen, Faults::none(), false).expect("an emulator");
        let endpoint = match emulator.listening() {
            Listening::Serial(path) => Endpoint::Serial(path.clone()),
            Listening::Tcp(address) => Endpoint::Tcp(address.to_string()),
        };
        let (mut device, clock) = open_device(&profile, &endpoint).expect("an open device");
        let mut times = Vec::with_capacity(SLOTS);
        for k in 0..SLOTS {
            // The counter of conversions must move between two slots.
            clock.sleep_until(clock.now_s() + 0.0022);
            let out = device.outgoing(0.0001 * (k % 7) as f64, false).expect("a current within the limits");
            let began_s = clock.now_s();
            if device.slot(&out, began_s, 0.05, &clock).quality == Quality::Good {
                times.push(clock.now_s() - began_s);
            }
        }
        times.sort_by(f64::total_cmp);
        let at = |q: f64| times.get((times.len() as f64 * q) as usize).copied().unwrap_or(f64::NAN);
        let wire_s = profile.budget().total_s;
        println!(
            "{name:<22} {:>10.0} {:>10.0} {:>10.0} {:>14.3} {:>14.3}   {} of {SLOTS} good",
            at(0.5) * 1e6,
            at(0.99) * 1e6,
            wire_s * 1e6,
            at(0.5) / wire_s,
            at(0.99) / wire_s,
            times.len()
        );
    }
}
