use dsbrdf_core::estimator::*;
use dsbrdf_core::levenberg_marquardt::LeastSquares;
use dsbrdf_core::observations::*;
use dsbrdf_core::shape::*;
use std::time::Instant;
fn main() {
    rayon::ThreadPoolBuilder::new().num_threads(1).build_global().unwrap();
    let n = 8100;
    let c = 3;
    let unit = |i: usize, k: usize| ((i * 7919 + k * 104_729) as f64 * 0.618_033_988_749_894_9).fract();
    let th: Vec<f64> = (0..n).map(|i| 1.5 * unit(i, 1).powi(2) + 0.001).collect();
    let x: Vec<f64> = (0..n).map(|i| unit(i, 2)).collect();
    let w = |k: usize| -> Vec<f64> { (0..n * 2 * c).map(|i| unit(i, k)).collect() };
    let o = Observations::new(
        &Given {
            ln_cos: &th.iter().map(|t| t.cos().ln()).collect::<Vec<_>>(),
            x: &x,
            azimuth: &(0..n * 2).map(|i| unit(i, 3)).collect::<Vec<_>>(),
            value: &w(4),
            weight: &w(5),
        },
        2,
        c,
    );
    let s = Shape {
        n_lobes: 6,
        n_channels: 3,
        sizes: Sizes { scale: 6, gamma: 4, beta: 3, falloff: 1, colour: 2 },
    };
    let mut p =
        Problem::new(&o, s, Loss::Log, &[0.01; 3], Penalty { bend: 0.25, slope: 0.05, size: 0.02 }, None);
    let xs = vec![0.3; p.shape.n_unknowns()];
    let reps = 50;
    let t = Instant::now();
    for _ in 0..reps {
        p.cost(&xs);
    }
    println!("cost {:?}", t.elapsed() / reps);
    let mut e = p.equations();
    let t = Instant::now();
    for _ in 0..reps {
        e.clear();
        p.linearise(&mut e);
    }
    println!("linearise {:?}", t.elapsed() / reps);
    let h = vec![false; e.size()];
    let t = Instant::now();
    for _ in 0..reps {
        let f = e.factor(1e-3, &h);
        std::hint::black_box(f.is_some());
    }
    println!("factor {:?}", t.elapsed() / reps);
}
