use dsbrdf_core::{em::*, levenberg_marquardt::*, lobe::*, mixture::*, slice::*};
use std::time::Instant;
fn main() {
    let n = 64;
    let lc: Vec<f64> = (0..n).map(|i| (0.02 + i as f64 * 0.02).cos().ln()).collect();
    let mut v = vec![0.; n];
    let mut s = vec![0.; n];
    let t = Instant::now();
    for i in 0..100000 {
        values_and_slopes(&lc, 1.0 + i as f64 * 1e-6, 30., &mut v, &mut s);
        std::hint::black_box(&v);
    }
    println!("values_and_slopes {:?} ns", t.elapsed().as_nanos() / 100000);
    let m: Vec<f64> = lc
        .iter()
        .flat_map(|l| {
            let f = (3. * (100. * l).exp()).exp_m1()
                + (0.5 * (5. * l).exp()).exp_m1()
                + 0.1
                + 0.01 * (l * 50.).sin();
            [180., 180. * f, 180. * f * f * 1.01, 0., 90., 1.0]
        })
        .collect();
    let sl = Slice::new(&m, &lc, &vec![0.5; n], Loss::L2);
    let st = halved_start(&sl, 3);
    for az in [false, true] {
        let mut mx = Mixture::new(&sl, 3, az);
        let x = [1.0, 4.0, 0.1, 0.3, 1.0, 0.1, 0.1, 0.1, 0.1];
        let p = if az { 9 } else { 6 };
        let t = Instant::now();
        for _ in 0..20000 {
            std::hint::black_box(mx.cost(&x[..p]));
        }
        println!("cost {:?} ns", t.elapsed().as_nanos() / 20000);
        let mut h = vec![0.; p * p];
        let mut g = vec![0.; p];
        let t = Instant::now();
        for _ in 0..20000 {
            mx.linearise(&mut h, &mut g);
            std::hint::black_box(&h);
        }
        println!("lin {:?} ns", t.elapsed().as_nanos() / 20000);
    }
    let t = Instant::now();
    let mut e = expectation_maximisation(&sl, st.clone(), 60, 1e-3);
    for _ in 0..99 {
        e = expectation_maximisation(&sl, st.clone(), 60, 1e-3);
    }
    println!("em {:?} us, rounds {}", t.elapsed().as_micros() / 100, e.history.len());
    let t = Instant::now();
    let mut it = 0;
    for _ in 0..100 {
        it = Mixture::new(&sl, 3, false)
            .fit(&e.lobes, Stop { max_iterations: 200, cost: 1e-9, zero: 0. })
            .1
            .iterations;
    }
    println!("polish {:?} us it {}", t.elapsed().as_micros() / 100, it);
}
