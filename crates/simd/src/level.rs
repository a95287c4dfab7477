//! Instruction sets, and the proof that this processor has one.

use crate::portable::{Array16, ArrayDot};
#[cfg(target_arch = "x86_64")]
use crate::x86::{Avx2Dot, Avx2x2, Avx512, Avx512Dot, VnniDot};
use crate::{ByteDot, SimdF32x16};

/// The name of an instruction set, whether or not this processor has it. [`SimdLevel`] is the proof that it does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InstructionSet {
    /// AVX-512 F, DQ, BW and VL with the byte products of VNNI.
    ///
    /// Differs from [`Self::Avx512`] in [`ByteDot`] alone: floating-point results are equal to the bit.
    Avx512Vnni,
    /// AVX-512 F, DQ, BW and VL: 512-bit vectors with fused multiply-add.
    Avx512,
    /// AVX2 and FMA: 256-bit vectors with fused multiply-add.
    Avx2,
    /// Whatever the build target has.
    Portable,
}

impl InstructionSet {
    /// All instruction sets, best first.
    pub const ALL: [Self; 4] = [Self::Avx512Vnni, Self::Avx512, Self::Avx2, Self::Portable];

    /// Whether this processor, and the operating system, can run it.
    fn is_detected(self) -> bool {
        // Miri does not support vector instructions, whatever processor it runs on.
        if cfg!(miri) {
            return self == Self::Portable;
        }
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Avx512Vnni => {
                is_x86_feature_detected!("avx512vnni") && Self::Avx512.is_detected()
            }
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => {
                is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512bw")
                    && is_x86_feature_detected!("avx512vl")
                    && Self::Avx2.is_detected()
            }
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma"),
            #[cfg(not(target_arch = "x86_64"))]
            Self::Avx512Vnni | Self::Avx512 | Self::Avx2 => false,
            Self::Portable => true,
        }
    }
}

/// An instruction set that this processor has. A value of this type is the proof.
///
/// Every constructor checks the processor, so that no safe program can run an instruction that the processor lacks:
///
/// ```
/// use radarllm_simd::{InstructionSet, SimdLevel};
///
/// match SimdLevel::new(InstructionSet::Avx512) {
///     Some(level) => assert_eq!(level.instruction_set(), InstructionSet::Avx512),
///     None => println!("no AVX-512 here: {:?} instead", SimdLevel::detect()),
/// }
/// // The portable level runs everywhere.
/// assert!(SimdLevel::available().any(|level| level == SimdLevel::PORTABLE));
/// ```
///
/// The field is private, so that a level cannot be claimed:
///
/// ```compile_fail,E0423
/// use radarllm_simd::{InstructionSet, SimdLevel};
///
/// let claimed = SimdLevel(InstructionSet::Avx512);
/// ```
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct SimdLevel(InstructionSet);

impl std::fmt::Debug for SimdLevel {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.0.fmt(f)
    }
}

impl SimdLevel {
    /// The level that every processor has.
    pub const PORTABLE: Self = Self(InstructionSet::Portable);

    /// The best level of this processor.
    pub fn detect() -> Self {
        Self::available().next().unwrap_or(Self::PORTABLE)
    }

    /// The level of `set`; `None` where this processor lacks it.
    pub fn new(set: InstructionSet) -> Option<Self> {
        set.is_detected().then_some(Self(set))
    }

    /// All levels of this processor, best first; the last is [`Self::PORTABLE`].
    pub fn available() -> impl Iterator<Item = Self> {
        InstructionSet::ALL.into_iter().filter_map(Self::new)
    }

    /// The instruction set of this level.
    pub fn instruction_set(self) -> InstructionSet {
        self.0
    }

    /// Runs a kernel that [`dispatch!`](crate::dispatch) made, with the vectors of this level.
    #[inline(always)]
    pub fn run<K: Kernel>(self, kernel: K) -> K::Output {
        match self.0 {
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx512Vnni | InstructionSet::Avx512 => {
                // SAFETY: this level exists only where `is_detected` found all of these features.
                unsafe { kernel.avx512::<Avx512>() }
            }
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx2 => {
                // SAFETY: as above.
                unsafe { kernel.avx2::<Avx2x2>() }
            }
            _ => kernel.portable::<Array16>(),
        }
    }

    /// As [`Self::run`], with the byte products of this level.
    #[inline(always)]
    pub fn run_bytes<K: ByteKernel>(self, kernel: K) -> K::Output {
        match self.0 {
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx512Vnni => {
                // SAFETY: this level exists only where `is_detected` found all of these features.
                unsafe { kernel.vnni::<Avx512, VnniDot>() }
            }
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx512 => {
                // SAFETY: as above.
                unsafe { kernel.avx512::<Avx512, Avx512Dot>() }
            }
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx2 => {
                // SAFETY: as above.
                unsafe { kernel.avx2::<Avx2x2, Avx2Dot>() }
            }
            _ => kernel.portable::<Array16, ArrayDot>(),
        }
    }
}

/// A computation that is compiled for every level. [`dispatch!`](crate::dispatch) creates one from a function.
///
/// The types behind `L` have no names outside this crate. Only a kernel receives them, and only from a [`SimdLevel`].
/// Their methods, which are the level's instructions, therefore cannot run elsewhere.
pub trait Kernel {
    /// Result of the computation.
    type Output;

    /// The computation with AVX-512 F, DQ, BW and VL.
    ///
    /// # Safety
    /// The processor must have these, AVX2 and FMA.
    #[cfg(target_arch = "x86_64")]
    unsafe fn avx512<L: SimdF32x16>(self) -> Self::Output;

    /// The computation with AVX2 and FMA.
    ///
    /// # Safety
    /// The processor must have these.
    #[cfg(target_arch = "x86_64")]
    unsafe fn avx2<L: SimdF32x16>(self) -> Self::Output;

    /// The computation with whatever the build target has.
    fn portable<L: SimdF32x16>(self) -> Self::Output;
}

/// As [`Kernel`], for computations that also multiply bytes.
pub trait ByteKernel {
    /// Result of the computation.
    type Output;

    /// The computation with AVX-512 F, DQ, BW, VL and VNNI.
    ///
    /// # Safety
    /// The processor must have these, AVX2 and FMA.
    #[cfg(target_arch = "x86_64")]
    unsafe fn vnni<L: SimdF32x16, D: ByteDot>(self) -> Self::Output;

    /// The computation with AVX-512 F, DQ, BW and VL.
    ///
    /// # Safety
    /// The processor must have these, AVX2 and FMA.
    #[cfg(target_arch = "x86_64")]
    unsafe fn avx512<L: SimdF32x16, D: ByteDot>(self) -> Self::Output;

    /// The computation with AVX2 and FMA.
    ///
    /// # Safety
    /// The processor must have these.
    #[cfg(target_arch = "x86_64")]
    unsafe fn avx2<L: SimdF32x16, D: ByteDot>(self) -> Self::Output;

    /// The computation with whatever the build target has.
    fn portable<L: SimdF32x16, D: ByteDot>(self) -> Self::Output;
}

/// Defines `fn name(level, args)`, which runs the generic function `body::<L>(args)` compiled for `level`.
///
/// With `bytes fn` in place of `fn` the body is `body::<L, D>(args)`, where D is a [`ByteDot`](crate::ByteDot).
/// Lifetimes of types are written out as `'_`.
///
/// The body, and whatever it calls with vectors, must be `#[inline(always)]`, and must use loops instead of iterator
/// methods with closures. A function that is not inlined is compiled without the level's instructions, and every
/// instruction in it becomes a call. `nm -C` on a binary lists such calls as functions of `core_arch`; there should be
/// none.
///
/// ```
/// use radarllm_simd::{SimdF32x16, SimdLevel, dispatch};
///
/// #[inline(always)]
/// fn dot_body<L: SimdF32x16>(a: &[[f32; 16]], b: &[[f32; 16]]) -> f32 {
///     let mut sum = L::splat(0.0);
///     for (a, b) in a.iter().zip(b) {
///         sum = L::load(a).fma(L::load(b), sum);
///     }
///     sum.reduce_sum()
/// }
/// dispatch!(fn dot => dot_body(a: &[[f32; 16]], b: &[[f32; 16]]) -> f32);
///
/// for level in SimdLevel::available() {
///     assert_eq!(dot(level, &[[1.0; 16]; 3], &[[2.0; 16]; 3]), 96.0);
/// }
/// ```
#[macro_export]
macro_rules! dispatch {
    ($(#[$meta:meta])* $vis:vis fn $name:ident => $body:ident ( $($arg:ident : $ty:ty),* $(,)? )) => {
        $crate::dispatch!($(#[$meta])* $vis fn $name => $body($($arg: $ty),*) -> ());
    };
    ($(#[$meta:meta])* $vis:vis bytes fn $name:ident => $body:ident ( $($arg:ident : $ty:ty),* $(,)? )) => {
        $crate::dispatch!($(#[$meta])* $vis bytes fn $name => $body($($arg: $ty),*) -> ());
    };
    ($(#[$meta:meta])* $vis:vis fn $name:ident => $body:ident ( $($arg:ident : $ty:ty),* $(,)? ) -> $out:ty) => {
        $(#[$meta])*
        $vis fn $name(level: $crate::SimdLevel, $($arg: $ty),*) -> $out {
            // The functions with target features take the arguments one by one. If the references were fields of a
            // structure, the compiler would not know that they do not overlap.
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx512f,avx512dq,avx512bw,avx512vl,avx2,fma")]
            fn avx512<L: $crate::SimdF32x16>($($arg: $ty),*) -> $out {
                $body::<L>($($arg),*)
            }
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx2,fma")]
            fn avx2<L: $crate::SimdF32x16>($($arg: $ty),*) -> $out {
                $body::<L>($($arg),*)
            }
            struct Call<A>(A);
            impl $crate::Kernel for Call<($($ty,)*)> {
                type Output = $out;
                #[cfg(target_arch = "x86_64")]
                #[inline(always)]
                unsafe fn avx512<L: $crate::SimdF32x16>(self) -> $out {
                    let Self(($($arg,)*)) = self;
                    // SAFETY: the caller promises that the processor has these features.
                    unsafe { avx512::<L>($($arg),*) }
                }
                #[cfg(target_arch = "x86_64")]
                #[inline(always)]
                unsafe fn avx2<L: $crate::SimdF32x16>(self) -> $out {
                    let Self(($($arg,)*)) = self;
                    // SAFETY: as above.
                    unsafe { avx2::<L>($($arg),*) }
                }
                #[inline(always)]
                fn portable<L: $crate::SimdF32x16>(self) -> $out {
                    let Self(($($arg,)*)) = self;
                    $body::<L>($($arg),*)
                }
            }
            level.run(Call(($($arg,)*)))
        }
    };
    ($(#[$meta:meta])* $vis:vis bytes fn $name:ident => $body:ident ( $($arg:ident : $ty:ty),* $(,)? ) -> $out:ty) => {
        $(#[$meta])*
        $vis fn $name(level: $crate::SimdLevel, $($arg: $ty),*) -> $out {
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx512f,avx512dq,avx512bw,avx512vl,avx512vnni,avx2,fma")]
            fn vnni<L: $crate::SimdF32x16, D: $crate::ByteDot>($($arg: $ty),*) -> $out {
                $body::<L, D>($($arg),*)
            }
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx512f,avx512dq,avx512bw,avx512vl,avx2,fma")]
            fn avx512<L: $crate::SimdF32x16, D: $crate::ByteDot>($($arg: $ty),*) -> $out {
                $body::<L, D>($($arg),*)
            }
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx2,fma")]
            fn avx2<L: $crate::SimdF32x16, D: $crate::ByteDot>($($arg: $ty),*) -> $out {
                $body::<L, D>($($arg),*)
            }
            struct Call<A>(A);
            impl $crate::ByteKernel for Call<($($ty,)*)> {
                type Output = $out;
                #[cfg(target_arch = "x86_64")]
                #[inline(always)]
                unsafe fn vnni<L: $crate::SimdF32x16, D: $crate::ByteDot>(self) -> $out {
                    let Self(($($arg,)*)) = self;
                    // SAFETY: the caller promises that the processor has these features.
                    unsafe { vnni::<L, D>($($arg),*) }
                }
                #[cfg(target_arch = "x86_64")]
                #[inline(always)]
                unsafe fn avx512<L: $crate::SimdF32x16, D: $crate::ByteDot>(self) -> $out {
                    let Self(($($arg,)*)) = self;
                    // SAFETY: as above.
                    unsafe { avx512::<L, D>($($arg),*) }
                }
                #[cfg(target_arch = "x86_64")]
                #[inline(always)]
                unsafe fn avx2<L: $crate::SimdF32x16, D: $crate::ByteDot>(self) -> $out {
                    let Self(($($arg,)*)) = self;
                    // SAFETY: as above.
                    unsafe { avx2::<L, D>($($arg),*) }
                }
                #[inline(always)]
                fn portable<L: $crate::SimdF32x16, D: $crate::ByteDot>(self) -> $out {
                    let Self(($($arg,)*)) = self;
                    $body::<L, D>($($arg),*)
                }
            }
            level.run_bytes(Call(($($arg,)*)))
        }
    };
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The operating system's description of the processor must contain the flags of every level that was found.
    #[test]
    #[cfg(all(target_arch = "x86_64", target_os = "linux"))]
    #[cfg_attr(
        miri,
        ignore = "reads a file of the system, and no level but the portable one exists"
    )]
    fn no_level_is_found_that_the_processor_lacks() {
        let cpuinfo = std::fs::read_to_string("/proc/cpuinfo").unwrap();
        let flags: Vec<&str> = cpuinfo
            .lines()
            .find_map(|line| line.strip_prefix("flags"))
            .map(|flags| flags.split_whitespace().collect())
            .unwrap_or_default();
        let avx512 = ["avx512f", "avx512dq", "avx512bw", "avx512vl"];
        for set in InstructionSet::ALL {
            let mut needed = vec![];
            if set != InstructionSet::Portable {
                needed.extend(["avx2", "fma"]);
            }
            if matches!(set, InstructionSet::Avx512 | InstructionSet::Avx512Vnni) {
                needed.extend(avx512);
            }
            if set == InstructionSet::Avx512Vnni {
                needed.push("avx512_vnni");
            }
            let lacking = needed.iter().find(|flag| !flags.contains(flag));
            if SimdLevel::new(set).is_some() {
                assert_eq!(lacking, None, "{set:?}");
            }
        }
    }

    #[test]
    fn levels_are_those_that_can_be_made_best_first() {
        let made: Vec<_> = InstructionSet::ALL
            .into_iter()
            .filter_map(SimdLevel::new)
            .collect();
        assert!(SimdLevel::available().eq(made.iter().copied()));
        assert_eq!(SimdLevel::detect(), made[0]);
        assert_eq!(made.last(), Some(&SimdLevel::PORTABLE));
        for level in made {
            assert_eq!(SimdLevel::new(level.instruction_set()), Some(level));
        }
    }
}
