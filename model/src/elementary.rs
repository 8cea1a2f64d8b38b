//! Elementary functions with the same result on every platform.
//!
//! The standard library takes `exp` and its kind from the platform's C library, and two versions of one library may differ in the last bit.
//! A model that is exported to C would then differ from the service. The functions here use only +, -, *, / and the bits of a number. Each
//! operation rounds once (IEEE 754), so the result is the same on every processor. The exported C code repeats the functions line by line
//! (`node/export/src/c`). Contraction into fused operations must be off, as it always is in Rust.
//!
//! ```text
//! exp x    = 2^e T_j e^r        x = (16 e + j) ln 2 / 16 + r,   |r| <= ln 2 / 32,   T_j = 2^(j/16): Taylor to r^7
//! ln x     = e ln 2 + ln c + 2 artanh s    x = 2^e z,   s = (z - c)/(z + c),   c the middle of the interval of z, 1 around 1
//! tanh x   = +-(e^(2|x|) - 1)/(e^(2|x|) + 1)
//! atan x   = atan(k/8) + atan t            t = (x - k/8)/(1 + x k/8),   |t| <= 1/16;    pi/2 - atan(1/x) above 1
//! sin x    = +-sin r or +-cos r            x = n pi/2 + r:   Taylor
//! ```
//!
//! [`tanh`] takes no difference of 1 and a number near 2^-33. GCC's library for Arm processors without an FPU for double precision (libgcc 12)
//! rounds such a difference wrongly: the exponents differ by 33, and the result is below the power of two.
//!
//! Tables and constants are held as a number and the rounding error of that number.
//!
//! | function | largest error found, ulp | arguments |
//! |---|---|---|
//! | [`exp`] | 0.6 | results from 1e-304 to the largest; smaller ones are rounded twice |
//! | [`exp_m1`] | 2.2 | all |
//! | [`ln`] | 2.0 | all |
//! | [`ln_1p`] | 2.4 | 0 to 1 |
//! | [`atan`] | 1.4 | all |
//! | [`sin`], [`cos`] | 2.0 | up to [`LARGEST_ANGLE`] |
//! | [`tanh`] | 3e-16 absolute | all |
//!
//! The test compares them with correctly rounded values of arbitrary-precision arithmetic. Table method: P. T. P. Tang, "Table-driven
//! implementation of the exponential function in IEEE floating-point arithmetic", ACM Trans. Math. Softw. 15 (1989) 144, and of the
//! logarithm, 16 (1990) 378.
//! See `[tang1989]` in the bibliography (node/docs/guide/bibliography.md).

/// Adding this constant to a number below 2^51 rounds it to an integer, which is then in the lowest bits.
const ROUND: f64 = 6_755_399_441_055_744.0;

/// 16/ln 2.
const STEPS_PER_UNIT: f64 = 23.083120654223414;
/// ln 2 / 16: 37 bits, and the rest.
const STEP: [f64; 2] = [0.04332169878489367, 1.0291218489310676e-13];
/// 2^(j/16).
#[rustfmt::skip]
#[allow(clippy::approx_constant, reason = "a table of them")]
const POWERS: [[f64; 2]; 16] = [
    [1.0, 0.0],
    [1.0442737824274138, 8.551889705537965e-17],
    [1.0905077326652577, -3.046782079812471e-17],
    [1.1387886347566916, 8.912812676025408e-17],
    [1.189207115002721, 3.982015231465646e-17],
    [1.241857812073484, 4.658027591836937e-17],
    [1.2968395546510096, 2.5382502794888315e-17],
    [1.3542555469368927, 7.70094837980299e-17],
    [1.4142135623730951, -9.667293313452913e-17],
    [1.4768261459394993, -3.483994556892796e-17],
    [1.5422108254079407, 7.949834809697621e-17],
    [1.6104903319492543, 2.4707192569797888e-17],
    [1.681792830507429, 8.199010020581497e-17],
    [1.7562521603732995, 2.960140695448873e-17],
    [1.8340080864093424, 3.283107224245627e-17],
    [1.9152065613971474, -1.0619946056195963e-16],
];

/// Exponent, table entry and remainder of an argument from -746 to 710; and e^r - 1.
#[inline(always)]
fn split(x: f64) -> (i32, [f64; 2], f64) {
    let shifted = x * STEPS_PER_UNIT + ROUND;
    // The lowest 32 bits of the sum are the integer.
    let index = (shifted.to_bits() as u32).cast_signed();
    let n = shifted - ROUND;
    let r = (x - n * STEP[0]) - n * STEP[1];
    let square = r * r;
    let far = (1.0 / 24.0 + r * (1.0 / 120.0)) + square * (1.0 / 720.0 + r * (1.0 / 5_040.0));
    let tail = (0.5 + r * (1.0 / 6.0)) + square * far;
    (index >> 4, POWERS[(index & 15) as usize], r + square * tail)
}

/// 2^e for e from -1022 to 1023.
#[inline(always)]
const fn power_of_two(e: i32) -> f64 {
    f64::from_bits(((e + 1023).cast_unsigned() as u64) << 52)
}

/// e^x. NaN stays NaN; infinite above 709.79, zero below -745.14.
///
/// ```
/// use mr_damper_model::elementary::exp;
///
/// assert!((exp(1.0) - std::f64::consts::E).abs() < 1e-15);
/// assert_eq!([exp(0.0), exp(-1e9), exp(f64::INFINITY)], [1.0, 0.0, f64::INFINITY]);
/// ```
#[inline(always)]
#[must_use]
pub fn exp(x: f64) -> f64 {
    if x.abs() <= 700.0 {
        let (e, [high, low], p) = split(x);
        return (high + (low + high * p)) * power_of_two(e);
    }
    exp_far(x)
}

/// [`exp`] where the power of two does not fit one factor.
#[cold]
#[inline(never)]
fn exp_far(x: f64) -> f64 {
    if x.is_nan() {
        return x;
    }
    if x > 710.0 {
        return f64::INFINITY;
    }
    if x < -746.0 {
        return 0.0;
    }
    let (e, [high, low], p) = split(x);
    let half = e / 2;
    (high + (low + high * p)) * power_of_two(half) * power_of_two(e - half)
}

/// e^x - 1, exact for small x. NaN stays NaN.
///
/// ```
/// use mr_damper_model::elementary::exp_m1;
///
/// assert_eq!([exp_m1(1e-18), exp_m1(-1e3)], [1e-18, -1.0]);
/// ```
#[inline]
#[must_use]
pub fn exp_m1(x: f64) -> f64 {
    if x.abs() <= 40.0 {
        let (e, [high, low], p) = split(x);
        let scale = power_of_two(e);
        return (scale * high - 1.0) + scale * (low + high * p);
    }
    exp(x) - 1.0
}

/// tanh x, with an absolute error of a few units in the last digit of 1, which suffices for forces. NaN stays NaN.
///
/// ```
/// use mr_damper_model::elementary::tanh;
///
/// assert_eq!([tanh(0.0), tanh(1e3), tanh(-1e3)], [0.0, 1.0, -1.0]);
/// ```
#[inline]
#[must_use]
pub fn tanh(x: f64) -> f64 {
    let size = x.abs();
    if size > 20.0 {
        return 1.0_f64.copysign(x);
    }
    let e = exp(2.0 * size);
    ((e - 1.0) / (e + 1.0)).copysign(x)
}

/// tanh with an absolute error of 3e-16, without branches or calls, so that the compiler vectorises loops over it. For a single
/// value it takes twice the time of [`tanh`].
///
/// ```text
/// tanh z = +-(e^(2|z|) - 1) / (e^(2|z|) + 1),   e^y = 2^n e^r,   n = round(y / ln 2),   |r| <= ln 2 / 2:  Taylor to r^12
/// ```
#[inline]
pub(crate) fn tanh_in_lanes(z: f64) -> f64 {
    const LN_2_HIGH: f64 = 6.931_471_803_691_238e-1;
    const LN_2_LOW: f64 = 1.908_214_929_270_587_7e-10;
    // 1/12!, 1/11!, ... 1/2!, 1, 1
    const TAYLOR: [f64; 13] = [
        1.0 / 479_001_600.0,
        1.0 / 39_916_800.0,
        1.0 / 3_628_800.0,
        1.0 / 362_880.0,
        1.0 / 40_320.0,
        1.0 / 5_040.0,
        1.0 / 720.0,
        1.0 / 120.0,
        1.0 / 24.0,
        1.0 / 6.0,
        0.5,
        1.0,
        1.0,
    ];
    // Beyond 20, tanh is 1 in double precision. NaN stays NaN.
    let y = 2.0 * z.abs().clamp(0.0, 20.0);
    let shifted = y * std::f64::consts::LOG2_E + ROUND;
    let n = shifted - ROUND;
    let r = (y - n * LN_2_HIGH) - n * LN_2_LOW;
    let mut series = 0.0;
    for coefficient in TAYLOR {
        series = series * r + coefficient;
    }
    let exp = f64::from_bits(series.to_bits().wrapping_add(shifted.to_bits() << 52));
    ((exp - 1.0) / (exp + 1.0)).copysign(z)
}

/// ln 2: 42 bits, and the rest.
const LN_2: [f64; 2] = [0.6931471805598903, 5.497923018708371e-14];
/// Middle c of each interval of the reduced argument, and ln c. The first interval begins at .6875; there are 32 in an octave of the
/// argument's bits. The two around 1 have c = 1, so that ln x is exact to rounding near 1.
#[rustfmt::skip]
const MIDDLES: [[f64; 3]; 32] = [
    [0.6953125, -0.3633938941874773, -2.106844752226605e-17],
    [0.7109375, -0.34117075740276714, 1.9366790062602867e-17],
    [0.7265625, -0.3194307707663612, -1.354256857264811e-18],
    [0.7421875, -0.29815337231907635, 1.720695867445866e-17],
    [0.7578125, -0.27731928541623435, 7.44528405583513e-18],
    [0.7734375, -0.2569104137850272, -2.502843296152504e-17],
    [0.7890625, -0.2369097470783577, -1.9682402978398164e-18],
    [0.8046875, -0.2173012756899814, -1.6168452453763015e-18],
    [0.8203125, -0.1980699137620938, -3.742843482461439e-18],
    [0.8359375, -0.179201429457711, 1.0785017454858423e-17],
    [0.8515625, -0.16068238169047347, 3.650183553047837e-18],
    [0.8671875, -0.14250006260728304, 9.926388234225749e-18],
    [0.8828125, -0.1246424452072766, 5.808912678940971e-18],
    [0.8984375, -0.1070981355563671, 1.73705104015906e-18],
    [0.9140625, -0.08985632912186105, 6.273760163689594e-19],
    [0.9296875, -0.07290677080808779, 6.306860257532778e-18],
    [0.9453125, -0.05623971832287608, 3.2835149805605613e-18],
    [0.9609375, -0.039845908547199674, 3.129547680315208e-18],
    [0.9765625, -0.023716526617316044, 1.5774243488668215e-18],
    [1.0, 0.0, 0.0],
    [1.0, 0.0, 0.0],
    [1.046875, 0.0458095360312942, 1.902959866474257e-18],
    [1.078125, 0.07522342123758753, -5.930604196293241e-18],
    [1.109375, 0.10379679368164356, 5.47772415726659e-18],
    [1.140625, 0.13157635778871926, 1.1123000879729588e-17],
    [1.171875, 0.15860503017663857, 1.1257003872182592e-17],
    [1.203125, 0.184922338494012, 3.0236614153574064e-18],
    [1.234375, 0.21056476910734964, -4.249405314729895e-18],
    [1.265625, 0.2355660713127669, -2.3943371495187355e-18],
    [1.296875, 0.25995752443692605, 2.069806938978935e-17],
    [1.328125, 0.2837681731306446, -2.032665581126656e-17],
    [1.359375, 0.3070250352949119, -1.2319916200101964e-17],
];
/// Bits of .6875.
const FIRST_MIDDLE: u64 = 0x3fe6_0000_0000_0000;

/// Natural logarithm; NaN for a negative number or NaN, minus infinity for zero.
///
/// ```
/// use mr_damper_model::elementary::ln;
///
/// assert_eq!([ln(1.0), ln(0.0), ln(f64::INFINITY)], [0.0, f64::NEG_INFINITY, f64::INFINITY]);
/// assert!((ln(10.0) - std::f64::consts::LN_10).abs() < 1e-15 && ln(-1.0).is_nan());
/// ```
#[inline(always)]
#[must_use]
pub fn ln(x: f64) -> f64 {
    if (f64::MIN_POSITIVE..f64::INFINITY).contains(&x) {
        return ln_scaled(x, 0);
    }
    ln_far(x)
}

/// [`ln`] of zero, subnormal and infinite numbers, and of those without one.
#[cold]
#[inline(never)]
fn ln_far(x: f64) -> f64 {
    if x == 0.0 {
        return f64::NEG_INFINITY;
    }
    if x > 0.0 && x < f64::INFINITY {
        return ln_scaled(x * power_of_two(54), -54);
    }
    if x > 0.0 { x } else { f64::NAN }
}

/// Logarithm of 2^`more` times a normal number.
#[inline(always)]
fn ln_scaled(x: f64, more: i32) -> f64 {
    let bits = x.to_bits();
    let beyond = bits.wrapping_sub(FIRST_MIDDLE);
    let e = beyond.cast_signed() >> 52;
    let z = f64::from_bits(bits.wrapping_sub(beyond & (0xfff << 52)));
    let [c, high, low] = MIDDLES[(beyond >> 47 & 31) as usize];
    let octaves = f64::from(e as i32 + more);
    let s = (z - c) / (z + c);
    let square = s * s;
    let fourth = square * square;
    let tail = (1.0 / 3.0 + square * (1.0 / 5.0))
        + fourth * ((1.0 / 7.0 + square * (1.0 / 9.0)) + fourth * (1.0 / 11.0));
    let whole = octaves * LN_2[0] + high;
    let rest = (octaves * LN_2[1] + low) + 2.0 * (s * square * tail);
    whole + (2.0 * s + rest)
}

/// ln(1 + x) for x from 0 to 1, exact for small x; beyond that range it loses accuracy but not its sense.
///
/// ```
/// use mr_damper_model::elementary::ln_1p;
///
/// assert_eq!(ln_1p(1e-18), 1e-18);
/// assert!((ln_1p(1.0) - std::f64::consts::LN_2).abs() < 1e-15);
/// ```
#[inline]
#[must_use]
pub fn ln_1p(x: f64) -> f64 {
    let sum = 1.0 + x;
    // The second term returns what the rounding of the sum lost.
    ln(sum) + (x - (sum - 1.0)) / sum
}

/// atan(k/8).
#[rustfmt::skip]
#[allow(clippy::approx_constant, reason = "a table of them")]
const ARCS: [[f64; 2]; 9] = [
    [0.0, 0.0],
    [0.12435499454676144, -3.1253241424539383e-18],
    [0.24497866312686414, 1.0698755618734451e-17],
    [0.35877067027057225, -2.4623815582638635e-17],
    [0.4636476090008061, 2.2698777452961687e-17],
    [0.5585993153435624, -5.4556305485916264e-18],
    [0.6435011087932844, 1.5834785051444286e-17],
    [0.7188299996216245, -2.1478388444456983e-17],
    [0.7853981633974483, 3.061616997868383e-17],
];
/// pi/2.
#[allow(clippy::approx_constant, reason = "a table of them")]
const QUARTER: [f64; 2] = [1.5707963267948966, 6.123233995736766e-17];

/// Arc tangent. NaN stays NaN.
///
/// ```
/// use mr_damper_model::elementary::atan;
///
/// assert_eq!(atan(0.0), 0.0);
/// assert!((atan(1.0) - std::f64::consts::FRAC_PI_4).abs() < 1e-15);
/// assert_eq!([atan(1e300), atan(f64::NEG_INFINITY)], [1.0, -1.0].map(|sign| sign * std::f64::consts::FRAC_PI_2));
/// ```
#[inline]
#[must_use]
pub fn atan(x: f64) -> f64 {
    let size = x.abs();
    let value = if size <= 1.0 {
        let k = nearest_eighth(size);
        let c = k as f64 * 0.125;
        arc(k, (size - c) / (1.0 + size * c))
    } else if size < 1e18 {
        let k = nearest_eighth(1.0 / size);
        let c = k as f64 * 0.125;
        // atan(1/x) with both terms of the quotient multiplied by x
        let t = (1.0 - size * c) / (size + c);
        let [high, low] = ARCS[k];
        (QUARTER[0] - high) - ((t + odd_terms(t)) + (low - QUARTER[1]))
    } else if size.is_nan() {
        return x;
    } else {
        QUARTER[0]
    };
    if x < 0.0 { -value } else { value }
}

/// 8 y rounded, for y from 0 to 1.
#[inline(always)]
fn nearest_eighth(y: f64) -> usize {
    ((y * 8.0 + ROUND).to_bits() & 15) as usize
}

/// atan(k/8) + atan t.
#[inline(always)]
fn arc(k: usize, t: f64) -> f64 {
    let [high, low] = ARCS[k];
    high + (t + (odd_terms(t) + low))
}

/// atan t - t for |t| up to 1/16.
#[inline(always)]
fn odd_terms(t: f64) -> f64 {
    let square = t * t;
    let fourth = square * square;
    let tail = (-1.0 / 3.0 + square * (1.0 / 5.0))
        + fourth * ((-1.0 / 7.0 + square * (1.0 / 9.0)) + fourth * (-1.0 / 11.0 + square * (1.0 / 13.0)));
    t * square * tail
}

/// Largest size of an angle, rad, that [`sin`] and [`cos`] take. Up to it the multiples of pi/2 are exact.
pub const LARGEST_ANGLE: f64 = 1e6;
/// pi/2 in three parts, of which the first two have 33 bits.
const QUARTER_PARTS: [f64; 3] = [1.5707963267341256, 6.077100506303966e-11, 2.0222662487959506e-21];

/// Sine of an angle in rad; NaN beyond [`LARGEST_ANGLE`].
///
/// ```
/// use mr_damper_model::elementary::{cos, sin};
///
/// assert_eq!([sin(0.0), cos(0.0)], [0.0, 1.0]);
/// assert!((sin(100.0) - -0.506_365_641_109_758_8).abs() < 1e-15 && sin(1e9).is_nan());
/// ```
#[inline]
#[must_use]
pub fn sin(x: f64) -> f64 {
    circular(x, 0)
}

/// Cosine of an angle in rad; NaN beyond [`LARGEST_ANGLE`].
///
/// ```
/// use mr_damper_model::elementary::cos;
///
/// assert!((cos(std::f64::consts::FRAC_PI_3) - 0.5).abs() < 1e-15);
/// ```
#[inline]
#[must_use]
pub fn cos(x: f64) -> f64 {
    circular(x, 1)
}

/// sin(x + `quarters` pi/2).
#[inline]
fn circular(x: f64, quarters: u64) -> f64 {
    if x.is_nan() || x.abs() > LARGEST_ANGLE {
        return f64::NAN;
    }
    let shifted = x * std::f64::consts::FRAC_2_PI + ROUND;
    let n = shifted - ROUND;
    let r = ((x - n * QUARTER_PARTS[0]) - n * QUARTER_PARTS[1]) - n * QUARTER_PARTS[2];
    let quarter = shifted.to_bits().wrapping_add(quarters) & 3;
    let value = if quarter & 1 == 0 { sine_near(r) } else { cosine_near(r) };
    if quarter & 2 == 0 { value } else { -value }
}

/// Sine up to pi/4.
#[inline(always)]
fn sine_near(r: f64) -> f64 {
    const TAYLOR: [f64; 8] = [
        1.0 / 355_687_428_096_000.0,
        -1.0 / 1_307_674_368_000.0,
        1.0 / 6_227_020_800.0,
        -1.0 / 39_916_800.0,
        1.0 / 362_880.0,
        -1.0 / 5_040.0,
        1.0 / 120.0,
        -1.0 / 6.0,
    ];
    let square = r * r;
    let mut series = 0.0;
    for coefficient in TAYLOR {
        series = series * square + coefficient;
    }
    r + r * square * series
}

/// Cosine up to pi/4.
#[inline(always)]
fn cosine_near(r: f64) -> f64 {
    const TAYLOR: [f64; 8] = [
        -1.0 / 6_402_373_705_728_000.0,
        1.0 / 20_922_789_888_000.0,
        -1.0 / 87_178_291_200.0,
        1.0 / 479_001_600.0,
        -1.0 / 3_628_800.0,
        1.0 / 40_320.0,
        -1.0 / 720.0,
        1.0 / 24.0,
    ];
    let square = r * r;
    let mut series = 0.0;
    for coefficient in TAYLOR {
        series = series * square + coefficient;
    }
    let half = 0.5 * square;
    let one = 1.0 - half;
    // The difference lost some digits, which are added again.
    one + (((1.0 - one) - half) + square * square * series)
}

/// Square root of the sum of two squares. The squares must not overflow.
#[inline]
pub(crate) fn hypot(a: f64, b: f64) -> f64 {
    (a * a + b * b).sqrt()
}

#[cfg(test)]
mod tests;
