// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Bjontegaard deltas against the published figures of the paper's downstream tables (SPARE-GS,
// arXiv 2607.16624), computed from the printed sizes and PSNRs, and against closed forms.

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "base/core.h"
#include "sparegs/rate_distortion.h"

// N/A in the table.
#define N NAN

typedef struct row {
    const char *name;
    sgs_rd_point base[3], ours[3];
    double rate, psnr, rate_tolerance;
} row;

// Half a unit of the last printed digit of the result, and what rounding the inputs to 0.01 dB and
// 0.01 MB adds. Larger where noted: the ranges of PSNR are short there.
static const row rows[] = {
    {"SOG m360",
     {{45.92, 26.44}, {39.28, 25.98}, {29.56, 24.71}},
     {{28.13, 26.25}, {24.13, 25.80}, {18.18, 24.49}},
     -35.60,
     N,
     0.01},
    {"SOG DB",
     {{45.20, 29.35}, {38.64, 29.05}, {28.54, 28.02}},
     {{19.27, 29.28}, {16.54, 28.99}, {12.27, 27.81}},
     -55.99,
     N,
     0.01},
    {"SOG T&T",
     {{25.84, 23.10}, {22.02, 22.80}, {16.57, 21.85}},
     {{15.21, 23.17}, {13.03, 22.79}, {9.87, 21.74}},
     -39.88,
     N,
     0.01},
    {"SOG Bungee",
     {{128.33, 27.40}, {110.47, 27.00}, {82.65, 25.71}},
     {{66.24, 27.15}, {57.22, 26.72}, {42.91, 25.43}},
     -44.17,
     N,
     0.01},
    {"MesonGS m360",
     {{24.41, 26.61}, {18.05, 26.54}, {11.38, 26.06}},
     {{16.43, 26.49}, {12.16, 26.28}, {7.72, 25.56}},
     -4.30,
     0.07,
     0.01},
    {"MesonGS T&T",
     {{12.56, 23.31}, {9.35, 23.19}, {7.54, 22.81}},
     {{10.52, 23.36}, {7.83, 23.12}, {5.12, 22.64}},
     -14.38,
     0.13,
     0.01},
    // The paper has -21.35, from values before rounding: two printed PSNRs of the anchor are equal.
    {"MesonGS DB",
     {{23.57, 29.82}, {17.50, 29.82}, {11.02, 29.54}},
     {{11.57, 29.82}, {8.58, 29.64}, {5.50, 29.03}},
     -25.7,
     0.25,
     0.05},
    {"MesonGS Bungee",
     {{65.79, 27.18}, {47.99, 27.35}, {29.62, 27.21}},
     {{36.57, 27.09}, {26.67, 27.12}, {16.53, 26.67}},
     N,
     N,
     0},
    {"FCGS m360",
     {{41.68, 27.35}, {34.75, 27.19}, {27.75, 27.01}},
     {{34.08, 27.28}, {24.71, 27.16}, {20.72, 27.01}},
     -24.34,
     0.17,
     0.01},
    {"FCGS DB",
     {{37.23, 29.67}, {27.62, 29.49}, {24.31, 29.24}},
     {{20.59, 29.71}, {14.75, 29.60}, {12.56, 29.47}},
     -53.99,
     N,
     0.01},
    {"FCGS T&T",
     {{24.71, 23.47}, {18.40, 23.39}, {16.00, 23.32}},
     {{17.73, 23.82}, {13.06, 23.77}, {11.18, 23.67}},
     N,
     0.47,
     0},
    {"GHAP m360",
     {{436.52, 27.43}, {311.69, 27.29}, {186.95, 27.00}},
     {{281.14, 27.31}, {200.73, 27.10}, {120.39, 26.73}},
     -9.29,
     0.06,
     0.01},
    {"GHAP T&T",
     {{258.91, 23.79}, {184.86, 23.76}, {110.87, 23.67}},
     {{162.22, 23.92}, {115.82, 23.80}, {69.46, 23.64}},
     -39.07,
     0.14,
     0.01},
    {"GHAP DB",
     {{410.42, 29.81}, {293.08, 29.82}, {175.83, 29.79}},
     {{186.02, 29.75}, {132.83, 29.70}, {79.67, 29.66}},
     N,
     -0.05,
     0},
    {"GHAP Bungee",
     {{1114.36, 27.63}, {795.87, 27.41}, {477.50, 26.94}},
     {{594.80, 27.46}, {424.80, 27.12}, {254.86, 26.47}},
     -26.10,
     0.30,
     0.01},
    {"PUP m360",
     {{436.61, 26.94}, {311.87, 24.66}, {187.12, 20.62}},
     {{281.21, 26.39}, {200.87, 23.05}, {120.52, 18.87}},
     -22.18,
     2.04,
     0.01},
    {"PUP DB",
     {{410.46, 29.77}, {293.19, 29.08}, {175.91, 25.67}},
     {{186.05, 29.61}, {132.90, 27.65}, {79.74, 21.73}},
     -39.48,
     3.57,
     0.01},
    {"PUP T&T",
     {{258.98, 23.06}, {184.98, 21.38}, {110.99, 18.06}},
     {{162.26, 22.96}, {115.90, 20.24}, {69.54, 16.54}},
     -26.16,
     2.03,
     0.02},
    {"PUP Bungee",
     {{1114.41, 27.68}, {796.01, 26.75}, {477.61, 23.49}},
     {{594.84, 27.38}, {424.89, 25.98}, {254.93, 21.67}},
     -35.97,
     2.65,
     0.01},
    {"REFINE m360",
     {{436.61, 27.25}, {311.87, 26.21}, {187.12, 23.55}},
     {{281.06, 26.65}, {200.91, 25.20}, {120.57, 21.89}},
     -18.55,
     1.07,
     0.01},
    {"REFINE DB",
     {{410.46, 29.59}, {293.19, 29.09}, {175.91, 27.64}},
     {{186.05, 29.40}, {132.90, 28.44}, {79.74, 26.29}},
     -40.77,
     1.59,
     0.04},
    // The paper's figures are from values before rounding.
    {"REFINE T&T",
     {{258.98, 23.35}, {184.98, 22.35}, {110.99, 20.15}},
     {{162.26, 23.27}, {115.90, 21.83}, {69.54, 19.33}},
     -28.60,
     1.425,
     0.11},
    {"REFINE Bungee",
     {{1114.41, 26.95}, {796.01, 25.45}, {477.61, 22.53}},
     {{594.84, 26.45}, {424.89, 24.52}, {254.93, 21.08}},
     -36.41,
     2.63,
     0.01},
    {"RAP m360",
     {{436.61, 27.37}, {311.87, 26.47}, {187.12, 24.08}},
     {{281.21, 27.02}, {200.87, 25.70}, {120.52, 23.12}},
     -21.54,
     1.08,
     0.01},
    {"RAP DB",
     {{410.46, 29.72}, {293.19, 29.22}, {175.91, 27.86}},
     {{186.05, 29.48}, {132.90, 28.54}, {79.74, 26.69}},
     -39.69,
     1.46,
     0.01},
    {"RAP T&T",
     {{258.98, 23.61}, {184.98, 22.93}, {110.99, 21.18}},
     {{162.26, 23.63}, {115.90, 22.62}, {69.54, 20.60}},
     -29.98,
     1.16,
     0.01},
    // LightGaussian's curves span 0.4 dB, where 0.005 dB of rounding moves the rate by half a
    // percent.
    {"LightGaussian m360",
     {{407.56, 27.19}, {321.67, 26.98}, {235.90, 26.76}},
     {{244.08, 27.05}, {192.69, 26.83}, {141.19, 26.58}},
     -27.78,
     N,
     0.7},
    {"LightGaussian DB",
     {{365.53, 29.66}, {289.13, 29.54}, {212.78, 29.31}},
     {{150.59, 29.63}, {119.31, 29.48}, {88.09, 29.30}},
     -55.38,
     N,
     0.7},
    {"LightGaussian T&T",
     {{238.77, 23.56}, {188.82, 23.44}, {138.66, 23.29}},
     {{137.43, 23.69}, {108.81, 23.53}, {79.85, 23.40}},
     -51.75,
     N,
     0.7},
    {"LightGaussian Bungee",
     {{1020.73, 27.68}, {804.53, 27.51}, {587.86, 27.36}},
     {{510.44, 27.56}, {402.31, 27.37}, {294.05, 27.18}},
     -37.50,
     N,
     0.7},
};

static bool agrees(double value, double published, double tolerance)
{
    return isnan(published) ? isnan(value) : fabs(value - published) <= tolerance;
}

static void the_published_figures_are_reproduced(void **state)
{
    (void)state;
    int bad = 0;
    for (size_t k = 0; k < sizeof rows / sizeof *rows; ++k) {
        sgs_bd bd;
        assert_int_equal(sgs_bd_compute(rows[k].base, 3, rows[k].ours, 3, &bd), 0);
        if (agrees(bd.rate_percent, rows[k].rate, rows[k].rate_tolerance) &&
            agrees(bd.psnr_db, rows[k].psnr, 0.0055) &&
            isnan(bd.rate_percent) == (bd.rate_reason != NULL) &&
            isnan(bd.psnr_db) == (bd.psnr_reason != NULL))
            continue;
        print_error("%s: rate %.4f (published %.2f), PSNR %.4f (%.3f)\n", rows[k].name,
                    bd.rate_percent, rows[k].rate, bd.psnr_db, rows[k].psnr);
        ++bad;
    }
    assert_int_equal(bad, 0);
}

static void halving_all_sizes_is_minus_fifty_percent(void **state)
{
    (void)state;
    const sgs_rd_point a[4] = {{8, 31}, {1, 25}, {4, 30}, {2, 28}};
    sgs_rd_point b[4];
    for (int k = 0; k < 4; ++k)
        b[k] = (sgs_rd_point){a[3 - k].size / 2, a[3 - k].psnr}; // in another order
    sgs_bd bd;
    assert_int_equal(sgs_bd_compute(a, 4, b, 4, &bd), 0);
    assert_true(fabs(bd.rate_percent + 50) < 1e-9);
    assert_int_equal(bd.ties, 0);
    // Raising all PSNRs by 0.5 dB.
    for (int k = 0; k < 4; ++k)
        b[k] = (sgs_rd_point){a[k].size, a[k].psnr + 0.5};
    assert_int_equal(sgs_bd_compute(a, 4, b, 4, &bd), 0);
    assert_true(fabs(bd.psnr_db - 0.5) < 1e-9);
    assert_true(bd.rate_percent < 0);
}

// On a straight line of PSNR over ln(size) the cubics are exact, so an affine curve has a closed
// form: test = anchor shifted by ln 3 in size and by a slope of 2 dB per unit of ln(size).
static void straight_curves_have_a_closed_form(void **state)
{
    (void)state;
    const sgs_rd_point a[3] = {{1, 20}, {exp(1), 22}, {exp(3), 26}};
    const sgs_rd_point b[3] = {{3, 20}, {3 * exp(2), 24}, {3 * exp(4), 28}};
    sgs_bd bd;
    assert_int_equal(sgs_bd_compute(a, 3, b, 3, &bd), 0);
    assert_true(fabs(bd.rate_percent - 200) < 1e-9);
    assert_true(fabs(bd.psnr_db + 2 * log(3)) < 1e-9);
}

static void figures_without_a_base_are_not_available(void **state)
{
    (void)state;
    const sgs_rd_point a[3] = {{10, 20}, {20, 25}, {40, 29}};
    const sgs_rd_point better[3] = {{10, 30}, {20, 31}, {40, 32}};
    const sgs_rd_point smaller[3] = {{1, 21}, {2, 25}, {10.3, 28}};
    const sgs_rd_point odd[3] = {{10, 20}, {20, 25}, {40, 24.9}};
    sgs_bd bd;
    assert_int_equal(sgs_bd_compute(a, 3, better, 3, &bd), 0);
    assert_true(isnan(bd.rate_percent) && bd.psnr_db > 0);
    assert_string_equal(bd.rate_reason, "the curves have no common range of PSNR");
    assert_int_equal(sgs_bd_compute(a, 3, smaller, 3, &bd), 0);
    assert_true(bd.rate_percent < 0 && isnan(bd.psnr_db)); // ratio 1.03
    assert_string_equal(bd.psnr_reason, "the curves have no common range of sizes of at least 4 %");
    assert_int_equal(sgs_bd_compute(a, 3, odd, 3, &bd), 0);
    assert_true(isnan(bd.rate_percent) && isnan(bd.psnr_db));
    assert_int_equal(sgs_bd_compute(a, 2, a, 3, &bd), 0);
    assert_string_equal(bd.rate_reason, "fewer than three points");
}

static void equal_points_are_moved_apart_and_counted(void **state)
{
    (void)state;
    const sgs_rd_point a[4] = {{10, 20}, {20, 25}, {20, 25}, {40, 29}};
    sgs_bd bd;
    assert_int_equal(sgs_bd_compute(a, 4, a, 4, &bd), 0);
    assert_int_equal(bd.ties, 2); // one in each curve, by PSNR and by size
    assert_true(fabs(bd.rate_percent) < 1e-9 && fabs(bd.psnr_db) < 1e-9);
    // By size and by PSNR: two different points.
    const sgs_rd_point b[4] = {{10, 20}, {10, 21}, {20, 25}, {40, 25}};
    const sgs_rd_point c[3] = {{10, 20}, {20, 25}, {40, 29}};
    assert_int_equal(sgs_bd_compute(b, 4, c, 3, &bd), 0);
    assert_int_equal(bd.ties, 2);
}

// The rate stays, however small the common range is; its width says what it is worth.
static void common_range_of_psnr_is_reported(void **state)
{
    (void)state;
    const sgs_rd_point a[3] = {{10, 20}, {20, 25}, {40, 29}};
    const sgs_rd_point narrow[3] = {{10, 28.9995}, {20, 31}, {40, 32}};
    const sgs_rd_point apart[3] = {{10, 30}, {20, 31}, {40, 32}};
    sgs_bd bd;
    assert_int_equal(sgs_bd_compute(a, 3, narrow, 3, &bd), 0);
    assert_true(fabs(bd.common_psnr_db - 0.0005) < 1e-12);
    assert_true(fabs(bd.rate_percent + 75) < 0.1 && !bd.rate_reason); // 10 instead of 40
    assert_int_equal(sgs_bd_compute(a, 3, a, 3, &bd), 0);
    assert_true(fabs(bd.common_psnr_db - 9) < 1e-12);
    assert_int_equal(sgs_bd_compute(a, 3, apart, 3, &bd), 0);
    assert_true(bd.common_psnr_db == 0);
}

static void invalid_points_are_refused(void **state)
{
    (void)state;
    const sgs_rd_point good[3] = {{1, 20}, {2, 21}, {3, 22}};
    const sgs_rd_point bad[][3] = {
        {{0, 20}, {2, 21}, {3, 22}},        {{1, 20}, {-2, 21}, {3, 22}},
        {{1, 20}, {INFINITY, 21}, {3, 22}}, {{1, 20}, {2, INFINITY}, {3, 22}},
        {{1, 20}, {2, 21}, {3, NAN}},       {{NAN, 20}, {2, 21}, {3, 22}}};
    sgs_bd bd;
    for (size_t k = 0; k < sizeof bad / sizeof *bad; ++k) {
        assert_int_equal(sgs_bd_compute(good, 3, bad[k], 3, &bd), SGS_STATUS_INVALID_ARGUMENT);
        assert_true(isnan(bd.rate_percent) && isnan(bd.psnr_db));
        assert_int_equal(sgs_bd_compute(bad[k], 3, good, 3, &bd), SGS_STATUS_INVALID_ARGUMENT);
    }
}

static void running_out_of_memory_is_an_error(void **state)
{
    (void)state;
    const sgs_rd_point good[3] = {{1, 20}, {2, 21}, {3, 22}};
    sgs_bd bd;
    for (size_t k = 1; k <= 9; ++k) {
        sgsi_fail_allocation(k);
        assert_int_equal(sgs_bd_compute(good, 3, good, 3, &bd), SGS_STATUS_OUT_OF_MEMORY);
    }
    sgsi_fail_allocation(0);
    assert_int_equal(sgs_bd_compute(good, 3, good, 3, &bd), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_published_figures_are_reproduced),
        cmocka_unit_test(halving_all_sizes_is_minus_fifty_percent),
        cmocka_unit_test(straight_curves_have_a_closed_form),
        cmocka_unit_test(figures_without_a_base_are_not_available),
        cmocka_unit_test(equal_points_are_moved_apart_and_counted),
        cmocka_unit_test(common_range_of_psnr_is_reported),
        cmocka_unit_test(invalid_points_are_refused),
        cmocka_unit_test(running_out_of_memory_is_an_error),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
