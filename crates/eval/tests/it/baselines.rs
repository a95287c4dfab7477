use radarllm_eval::baselines::{NearestNeighbour, majority_caption, shuffled_assignment};

#[test]
fn majority_counts_normalised_text_and_breaks_ties_by_order() {
    assert_eq!(
        majority_caption(&["b c", "A walk.", "a  walk", "b d"]),
        Some("A walk.")
    );
    assert_eq!(majority_caption(&["z", "a", "a!", "Z"]), Some("z"));
    assert_eq!(majority_caption(&[]), None);
}

#[test]
fn shuffling_is_a_seeded_derangement() {
    for n in [0, 2, 3, 10, 1000] {
        let mut a = shuffled_assignment(n, 4).unwrap();
        assert_eq!(Some(&a), shuffled_assignment(n, 4).as_ref());
        assert!(a.iter().enumerate().all(|(i, &j)| i != j));
        a.sort_unstable();
        assert!(a.into_iter().eq(0..n));
    }
    assert_ne!(shuffled_assignment(1000, 4), shuffled_assignment(1000, 5));
    assert_eq!(shuffled_assignment(1, 0), None);
}

#[test]
fn nearest_agrees_with_a_slow_search_and_ignores_scale() {
    // Fixed pseudo-random vectors; dimension 3 is a thousand times larger, dimension 7 is constant.
    let value = |i: usize, d: usize| {
        let v = ((i * 131 + d * 57 + 11) * 2_654_435_761 % 1_000_003) as f32 / 1e6;
        match d {
            3 => v * 1000.0,
            7 => 5.0,
            _ => v,
        }
    };
    let train: Vec<Vec<f32>> = (0..300)
        .map(|i| (0..70).map(|d| value(i, d)).collect())
        .collect();
    let nn = NearestNeighbour::fit(&train).unwrap();
    let n = train.len() as f64;
    let mean: Vec<f64> = (0..70)
        .map(|d| train.iter().map(|v| f64::from(v[d])).sum::<f64>() / n)
        .collect();
    let deviation: Vec<f64> = (0..70)
        .map(|d| {
            (train
                .iter()
                .map(|v| (f64::from(v[d]) - mean[d]).powi(2))
                .sum::<f64>()
                / n)
                .sqrt()
        })
        .collect();
    for i in 300..340 {
        let mut query: Vec<f32> = (0..70).map(|d| value(i, d)).collect();
        query[7] = -100.0; // constant in training: must not matter
        let distance = |v: &Vec<f32>| -> f64 {
            (0..70)
                .filter(|&d| d != 7)
                .map(|d| (f64::from(v[d] - query[d]) / deviation[d]).powi(2))
                .sum()
        };
        let slow = (0..train.len())
            .min_by(|&a, &b| distance(&train[a]).total_cmp(&distance(&train[b])))
            .unwrap();
        assert_eq!(nn.nearest(&query).unwrap(), slow);
    }
    assert_eq!(nn.nearest(&train[17]).unwrap(), 17);
    assert!(nn.nearest(&[0.0; 3]).is_err() && nn.nearest(&[f32::NAN; 70]).is_err());
    assert!(NearestNeighbour::fit::<Vec<f32>>(&[]).is_err());
    assert!(NearestNeighbour::fit(&[vec![0.0], vec![0.0, 1.0]]).is_err());
}
