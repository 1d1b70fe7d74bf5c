//! tuning
fn main() {
    let a: Vec<String> = std::env::args().collect();
    for pair in a[1..].chunks(2) {
        let r = hil::recording::Recording::read(std::path::Path::new(&pair[0]), &[]).unwrap();
        let v = hil::valve::Valve::load(std::path::Path::new(&pair[1])).unwrap();
        let t = std::time::Instant::now();
        let o = hil::diagnose::probe(&r, &v).unwrap();
        println!("== {} {:.2} s\n{o}", pair[0], t.elapsed().as_secs_f64());
    }
}
