use radarllm_metrics::bootstrap::{mean_interval, units_of_ids};

#[test]
fn interval_of_a_mean_has_the_width_of_the_normal_law() {
    // 10,000 values of mean 0 and variance 1 (+-1): the mean's 95 % interval is +-1.96 / 100.
    let values: Vec<f64> = (0..10_000)
        .map(|i| if i % 2 == 0 { 1.0 } else { -1.0 })
        .collect();
    let units: Vec<usize> = (0..10_000).collect();
    let [low, high] = mean_interval(&values, &units, 1000, 3).unwrap();
    // A 2.5 % quantile from 1,000 draws has a standard error of about 7 % of 0.0196: allow 4 of them.
    assert!(
        (low + 0.0196).abs() < 0.0055 && (high - 0.0196).abs() < 0.0055,
        "{low} {high}"
    );
}

#[test]
fn copies_of_a_motion_do_not_narrow_the_interval() {
    let values: Vec<f64> = (0..200).map(f64::from).collect();
    let units: Vec<usize> = (0..200).collect();
    let tenfold: Vec<f64> = values.iter().flat_map(|v| [*v; 10]).collect();
    let tenfold_units: Vec<usize> = units.iter().flat_map(|u| [*u; 10]).collect();
    let [a, b] = mean_interval(&values, &units, 1000, 5).unwrap();
    let [c, d] = mean_interval(&tenfold, &tenfold_units, 1000, 5).unwrap();
    // The same draws of the same units: equal up to rounding of the tenfold sums.
    assert!((a - c).abs() < 1e-9 && (b - d).abs() < 1e-9);
    let independent: Vec<usize> = (0..2000).collect();
    let [e, f] = mean_interval(&tenfold, &independent, 1000, 5).unwrap();
    assert!(
        f - e < 0.5 * (b - a),
        "ten times the units, about 0.32 of the width"
    );
}

#[test]
fn units_are_motions() {
    assert_eq!(
        units_of_ids(["walk#0", "walk#1", "run#0", "plain", "walk#2"]),
        [0, 0, 1, 2, 0]
    );
    assert_eq!(mean_interval(&[], &[], 10, 0), None);
}
