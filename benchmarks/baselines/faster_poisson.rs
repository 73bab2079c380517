// faster_poisson (crates.io, MIT licence) as a program: side of the square in distances, attempts, seed; the seconds it
// took to the standard error, the points to the standard output as pairs of doubles. docs/benchmarks.md says how to build it.
use faster_poisson::Poisson2D;
use std::io::Write;

fn main() {
    let given: Vec<String> = std::env::args().collect();
    let side: f64 = given[1].parse().unwrap();
    let start = std::time::Instant::now();
    let points = Poisson2D::new()
        .dims([side, side])
        .radius(1.0)
        .attempts(given[2].parse().unwrap())
        .seed(Some(given[3].parse().unwrap()))
        .run();
    let seconds = start.elapsed().as_secs_f64();
    eprint!("{{\"seconds\": {seconds}}}");
    let bytes: Vec<u8> = points.iter().flatten().flat_map(|each| each.to_ne_bytes()).collect();
    std::io::stdout().write_all(&bytes).unwrap();
}
