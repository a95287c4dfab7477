//! ROUGE-1 and ROUGE-L by rouge-score's rules, and ROUGE-L by COCO's.

/// F1 of unigram overlap, best over references. Tokens as in [`crate::tokens::rouge_score`].
pub fn rouge_1(candidate: &[String], references: &[Vec<String>]) -> f64 {
    best(candidate, references, |c, r| {
        let (mut c, mut r): (Vec<&String>, Vec<&String>) = (c.iter().collect(), r.iter().collect());
        c.sort_unstable();
        r.sort_unstable();
        let (mut i, mut j, mut common) = (0, 0, 0);
        while i < c.len() && j < r.len() {
            match c[i].cmp(r[j]) {
                std::cmp::Ordering::Less => i += 1,
                std::cmp::Ordering::Greater => j += 1,
                std::cmp::Ordering::Equal => (i, j, common) = (i + 1, j + 1, common + 1),
            }
        }
        common
    })
}

/// F1 of the longest common subsequence, best over references. Tokens as in
/// [`crate::tokens::rouge_score`].
pub fn rouge_l(candidate: &[String], references: &[Vec<String>]) -> f64 {
    best(candidate, references, lcs)
}

/// COCO's ROUGE-L: F-measure with beta = 1.2. Precision and recall are each the best over the references, possibly of
/// different ones. Texts are split at single spaces, so that an empty text is one empty token and two empty texts
/// agree. This peculiarity of the original is kept.
pub fn rouge_l_coco(candidate: &str, references: &[String]) -> f64 {
    const BETA_SQUARED: f64 = 1.2 * 1.2;
    let c: Vec<&str> = candidate.split(' ').collect();
    let (mut precision, mut recall) = (0.0_f64, 0.0_f64);
    for reference in references {
        let r: Vec<&str> = reference.split(' ').collect();
        let common = lcs(&c, &r) as f64;
        precision = precision.max(common / c.len() as f64);
        recall = recall.max(common / r.len() as f64);
    }
    if precision == 0.0 || recall == 0.0 {
        return 0.0;
    }
    (1.0 + BETA_SQUARED) * precision * recall / (recall + BETA_SQUARED * precision)
}

fn best(
    candidate: &[String],
    references: &[Vec<String>],
    common: impl Fn(&[String], &[String]) -> usize,
) -> f64 {
    let f1 = |reference: &Vec<String>| {
        // F1 = 2 m / (|c| + |r|) for m matches. It is 0 if both texts are empty.
        let lengths = candidate.len() + reference.len();
        if lengths == 0 {
            0.0
        } else {
            2.0 * common(candidate, reference) as f64 / lengths as f64
        }
    };
    references.iter().map(f1).fold(0.0, f64::max)
}

/// Length of the longest common subsequence. Only one row of the table is stored.
fn lcs<T: PartialEq>(a: &[T], b: &[T]) -> usize {
    let mut row = vec![0_usize; b.len() + 1];
    for x in a {
        let mut diagonal = 0;
        for (j, y) in b.iter().enumerate() {
            let above = row[j + 1];
            row[j + 1] = if x == y {
                diagonal + 1
            } else {
                above.max(row[j])
            };
            diagonal = above;
        }
    }
    row[b.len()]
}
