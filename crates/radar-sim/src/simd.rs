//! Sixteen `f32` lanes: one per channel in [`crate::spread`].
//!
//! Three implementations of one trait, chosen once per [`crate::Simulator`] at run time. Results
//! are equal within rounding between them and equal to the byte on one of them (the AVX-512 and
//! AVX2 ones fuse multiply and add, the portable one does not).

/// Instruction set used by a simulator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SimdLevel {
    /// 512-bit vectors with fused multiply-add.
    Avx512,
    /// 256-bit vectors with fused multiply-add.
    Avx2,
    /// Whatever the build target has.
    Portable,
}

impl SimdLevel {
    /// The best level of this machine.
    pub fn detect() -> Self {
        [Self::Avx512, Self::Avx2]
            .into_iter()
            .find(|l| l.is_available())
            .unwrap_or(Self::Portable)
    }

    /// Whether this machine can run it.
    pub fn is_available(self) -> bool {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => {
                is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512bw")
                    && is_x86_feature_detected!("avx512vl")
                    && Self::Avx2.is_available()
            }
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma"),
            #[cfg(not(target_arch = "x86_64"))]
            Self::Avx512 | Self::Avx2 => false,
            Self::Portable => true,
        }
    }
}

/// Sixteen floats.
pub(crate) trait Lanes: Copy {
    fn splat(x: f32) -> Self;
    fn load(from: &[f32; 16]) -> Self;
    fn store(self, to: &mut [f32; 16]);
    fn add(self, other: Self) -> Self;
    fn sub(self, other: Self) -> Self;
    fn mul(self, other: Self) -> Self;
    fn div(self, other: Self) -> Self;
    /// `self * factor + term`.
    fn fma(self, factor: Self, term: Self) -> Self;
    /// `term - self * factor`.
    fn fnma(self, factor: Self, term: Self) -> Self;
    fn sqrt(self) -> Self;
    /// To the nearest integer, ties to even.
    fn round(self) -> Self;
    fn min(self, other: Self) -> Self;
    fn max(self, other: Self) -> Self;
    /// `if self < limit { yes } else { no }`, lane by lane.
    fn select_lt(self, limit: Self, yes: Self, no: Self) -> Self;

    /// `c[0] + c[1] x + ...`.
    #[inline(always)]
    fn polynomial<const N: usize>(self, c: &[f32; N]) -> Self {
        let mut sum = Self::splat(c[N - 1]);
        for i in (0..N - 1).rev() {
            sum = sum.fma(self, Self::splat(c[i]));
        }
        sum
    }
}

/// Sine and cosine of `2 pi x`, absolute error below 1e-6 for |x| < 1e4 (beyond the input's own
/// rounding).
#[inline(always)]
pub(crate) fn sin_cos_turns<L: Lanes>(x: L) -> (L, L) {
    // q in [-1/2, 1/2] turns; polynomials give the half angle (pi q in [-pi/2, pi/2]), the
    // double-angle formulas the rest: no quadrant logic.
    let q = x.sub(x.round());
    let y = q.mul(q);
    // Minimax over |q| <= 1/2 of sin(pi q)/q (times q) and cos(pi q) in q^2: errors of 3e-9 and 5e-8.
    let s = y
        .polynomial(&[
            std::f32::consts::PI,
            -5.167_707,
            2.550_031_4,
            -0.598_045_2,
            0.077_220_13,
        ])
        .mul(q);
    let c = y.polynomial(&[1.0, -4.934_793, 4.058_412, -1.331_880_2, 0.219_696_8]);
    let two_s = s.add(s);
    (two_s.mul(c), two_s.fnma(s, L::splat(1.0)))
}

/// Portable lanes.
#[derive(Clone, Copy)]
pub(crate) struct Array16([f32; 16]);

impl Array16 {
    #[inline(always)]
    fn map2(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        Self(std::array::from_fn(|i| f(self.0[i], other.0[i])))
    }
}

impl Lanes for Array16 {
    #[inline(always)]
    fn splat(x: f32) -> Self {
        Self([x; 16])
    }
    #[inline(always)]
    fn load(from: &[f32; 16]) -> Self {
        Self(*from)
    }
    #[inline(always)]
    fn store(self, to: &mut [f32; 16]) {
        *to = self.0;
    }
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.map2(other, |a, b| a + b)
    }
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.map2(other, |a, b| a - b)
    }
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.map2(other, |a, b| a * b)
    }
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        self.map2(other, |a, b| a / b)
    }
    #[inline(always)]
    fn fma(self, factor: Self, term: Self) -> Self {
        self.mul(factor).add(term)
    }
    #[inline(always)]
    fn fnma(self, factor: Self, term: Self) -> Self {
        term.sub(self.mul(factor))
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0.map(f32::sqrt))
    }
    #[inline(always)]
    fn round(self) -> Self {
        // Adding 1.5 * 2^23 rounds to the nearest integer without a library call; |x| < 2^22.
        const MAGIC: f32 = 12_582_912.0;
        Self(self.0.map(|x| (x + MAGIC) - MAGIC))
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.map2(other, |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.map2(other, |a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    fn select_lt(self, limit: Self, yes: Self, no: Self) -> Self {
        Self(std::array::from_fn(|i| {
            if self.0[i] < limit.0[i] {
                yes.0[i]
            } else {
                no.0[i]
            }
        }))
    }
}

#[cfg(target_arch = "x86_64")]
pub(crate) use x86::{Avx2x2, Avx512};

#[cfg(target_arch = "x86_64")]
mod x86 {
    use std::arch::x86_64::*;

    use super::Lanes;

    /// Calls one intrinsic.
    ///
    /// The types of this module are named only by the `dispatch!`ed entry points of this crate,
    /// which are compiled for, and called only after detecting, the features concerned.
    macro_rules! intrinsic {
        ($call:expr) => {{
            // SAFETY: the module's types are used only on machines where `SimdLevel::is_available`
            // said yes, and pointers come from references to 16 floats.
            unsafe { $call }
        }};
    }

    /// One 512-bit register.
    #[derive(Clone, Copy)]
    pub(crate) struct Avx512(__m512);

    impl Lanes for Avx512 {
        #[inline(always)]
        fn splat(x: f32) -> Self {
            Self(intrinsic!(_mm512_set1_ps(x)))
        }
        #[inline(always)]
        fn load(from: &[f32; 16]) -> Self {
            Self(intrinsic!(_mm512_loadu_ps(from.as_ptr())))
        }
        #[inline(always)]
        fn store(self, to: &mut [f32; 16]) {
            intrinsic!(_mm512_storeu_ps(to.as_mut_ptr(), self.0));
        }
        #[inline(always)]
        fn add(self, other: Self) -> Self {
            Self(intrinsic!(_mm512_add_ps(self.0, other.0)))
        }
        #[inline(always)]
        fn sub(self, other: Self) -> Self {
            Self(intrinsic!(_mm512_sub_ps(self.0, other.0)))
        }
        #[inline(always)]
        fn mul(self, other: Self) -> Self {
            Self(intrinsic!(_mm512_mul_ps(self.0, other.0)))
        }
        #[inline(always)]
        fn div(self, other: Self) -> Self {
            Self(intrinsic!(_mm512_div_ps(self.0, other.0)))
        }
        #[inline(always)]
        fn fma(self, factor: Self, term: Self) -> Self {
            Self(intrinsic!(_mm512_fmadd_ps(self.0, factor.0, term.0)))
        }
        #[inline(always)]
        fn fnma(self, factor: Self, term: Self) -> Self {
            Self(intrinsic!(_mm512_fnmadd_ps(self.0, factor.0, term.0)))
        }
        #[inline(always)]
        fn sqrt(self) -> Self {
            Self(intrinsic!(_mm512_sqrt_ps(self.0)))
        }
        #[inline(always)]
        fn round(self) -> Self {
            Self(intrinsic!(_mm512_roundscale_ps::<0>(self.0)))
        }
        #[inline(always)]
        fn min(self, other: Self) -> Self {
            Self(intrinsic!(_mm512_min_ps(self.0, other.0)))
        }
        #[inline(always)]
        fn max(self, other: Self) -> Self {
            Self(intrinsic!(_mm512_max_ps(self.0, other.0)))
        }
        #[inline(always)]
        fn select_lt(self, limit: Self, yes: Self, no: Self) -> Self {
            Self(intrinsic!(_mm512_mask_blend_ps(
                _mm512_cmp_ps_mask::<_CMP_LT_OQ>(self.0, limit.0),
                no.0,
                yes.0
            )))
        }
    }

    /// Two 256-bit registers.
    #[derive(Clone, Copy)]
    pub(crate) struct Avx2x2(__m256, __m256);

    macro_rules! both {
        ($f:ident, $($x:expr),+) => {
            Self(intrinsic!($f($($x.0),+)), intrinsic!($f($($x.1),+)))
        };
    }

    impl Lanes for Avx2x2 {
        #[inline(always)]
        fn splat(x: f32) -> Self {
            let v = intrinsic!(_mm256_set1_ps(x));
            Self(v, v)
        }
        #[inline(always)]
        fn load(from: &[f32; 16]) -> Self {
            Self(
                intrinsic!(_mm256_loadu_ps(from.as_ptr())),
                intrinsic!(_mm256_loadu_ps(from.as_ptr().add(8))),
            )
        }
        #[inline(always)]
        fn store(self, to: &mut [f32; 16]) {
            intrinsic!(_mm256_storeu_ps(to.as_mut_ptr(), self.0));
            intrinsic!(_mm256_storeu_ps(to.as_mut_ptr().add(8), self.1));
        }
        #[inline(always)]
        fn add(self, other: Self) -> Self {
            both!(_mm256_add_ps, self, other)
        }
        #[inline(always)]
        fn sub(self, other: Self) -> Self {
            both!(_mm256_sub_ps, self, other)
        }
        #[inline(always)]
        fn mul(self, other: Self) -> Self {
            both!(_mm256_mul_ps, self, other)
        }
        #[inline(always)]
        fn div(self, other: Self) -> Self {
            both!(_mm256_div_ps, self, other)
        }
        #[inline(always)]
        fn fma(self, factor: Self, term: Self) -> Self {
            both!(_mm256_fmadd_ps, self, factor, term)
        }
        #[inline(always)]
        fn fnma(self, factor: Self, term: Self) -> Self {
            both!(_mm256_fnmadd_ps, self, factor, term)
        }
        #[inline(always)]
        fn sqrt(self) -> Self {
            both!(_mm256_sqrt_ps, self)
        }
        #[inline(always)]
        fn round(self) -> Self {
            Self(
                intrinsic!(_mm256_round_ps::<0>(self.0)),
                intrinsic!(_mm256_round_ps::<0>(self.1)),
            )
        }
        #[inline(always)]
        fn min(self, other: Self) -> Self {
            both!(_mm256_min_ps, self, other)
        }
        #[inline(always)]
        fn max(self, other: Self) -> Self {
            both!(_mm256_max_ps, self, other)
        }
        #[inline(always)]
        fn select_lt(self, limit: Self, yes: Self, no: Self) -> Self {
            let mask = |a, b| intrinsic!(_mm256_cmp_ps::<_CMP_LT_OQ>(a, b));
            Self(
                intrinsic!(_mm256_blendv_ps(no.0, yes.0, mask(self.0, limit.0))),
                intrinsic!(_mm256_blendv_ps(no.1, yes.1, mask(self.1, limit.1))),
            )
        }
    }
}

/// Defines `$name(level, args)`, which runs the generic `$body::<L>(args)` compiled for `level`.
macro_rules! dispatch {
    ($(#[$meta:meta])* $vis:vis fn $name:ident => $body:ident ( $($arg:ident : $ty:ty),* $(,)? )) => {
        $(#[$meta])*
        $vis fn $name(level: $crate::simd::SimdLevel, $($arg: $ty),*) {
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx512f,avx512dq,avx512bw,avx512vl,avx2,fma")]
            fn avx512($($arg: $ty),*) {
                $body::<$crate::simd::Avx512>($($arg),*);
            }
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx2,fma")]
            fn avx2($($arg: $ty),*) {
                $body::<$crate::simd::Avx2x2>($($arg),*);
            }
            match level {
                // SAFETY: a simulator takes a level only after `is_available`.
                #[cfg(target_arch = "x86_64")]
                $crate::simd::SimdLevel::Avx512 => unsafe { avx512($($arg),*) },
                // SAFETY: as above.
                #[cfg(target_arch = "x86_64")]
                $crate::simd::SimdLevel::Avx2 => unsafe { avx2($($arg),*) },
                _ => $body::<$crate::simd::Array16>($($arg),*),
            }
        }
    };
}
pub(crate) use dispatch;

#[cfg(test)]
mod tests {
    use super::*;

    #[inline(always)]
    fn sin_cos_body<L: Lanes>(x: &[f32; 16], out: &mut [[f32; 16]; 2]) {
        let (s, c) = sin_cos_turns(L::load(x));
        s.store(&mut out[0]);
        c.store(&mut out[1]);
    }
    dispatch!(fn sin_cos => sin_cos_body(x: &[f32; 16], out: &mut [[f32; 16]; 2]));

    #[test]
    fn sine_and_cosine_are_accurate_at_every_level() {
        for level in [SimdLevel::Avx512, SimdLevel::Avx2, SimdLevel::Portable] {
            if !level.is_available() {
                continue;
            }
            for i in 0..4000 {
                let x: [f32; 16] = std::array::from_fn(|j| (i * 16 + j) as f32 * 7.3e-4 - 20.0);
                let mut out = [[0.0; 16]; 2];
                sin_cos(level, &x, &mut out);
                for j in 0..16 {
                    let (s, c) = (f64::from(x[j]) * std::f64::consts::TAU).sin_cos();
                    // f32 evaluation of a degree-6 polynomial: a few roundings of 1.2e-7, doubled once.
                    assert!(
                        (f64::from(out[0][j]) - s).abs() < 1e-6,
                        "{level:?} sin {}",
                        x[j]
                    );
                    assert!(
                        (f64::from(out[1][j]) - c).abs() < 1e-6,
                        "{level:?} cos {}",
                        x[j]
                    );
                }
            }
        }
    }
}
