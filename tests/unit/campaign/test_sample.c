/* SPDX-License-Identifier: MIT
 *
 * test_sample.c - the values of a row follow from its number, as the literature says.
 */
#include "cases.h"
#include "campaign/space/sample.h"

#include <inttypes.h>
#include <math.h>

/* Roots of x^(d + 1) = x + 1 for d = 1 to 4: the golden ratio, the plastic number, and so on. */
static const double roots[] = {1.618033988749894848, 1.324717957244746026, 1.220744084605759475,
                               1.167303978261418685};
static const char *const names[] = {"a", "b", "c", "d"};

static campaign *new_campaign(campaign_sample sample, const uint64_t *counts, size_t factors)
{
    campaign *c = calloc(1, sizeof *c);
    assert_non_null(c);
    c->sample = sample;
    c->seed = 5;
    c->sample_count = 1000;
    c->factor_count = factors;
    for (size_t i = 0; i < factors; i++)
        c->factors[i] = (factor){.name = names[i], .kind = FACTOR_RANGE, .count = counts[i],
                                 .step.mantissa = 1};
    assert_null(sample_prepare(c));
    return c;
}

/* ---- Rows ------------------------------------------------------------------------------------ */

TEST(a_full_product_counts_with_the_last_factor_first)
{
    static const uint64_t counts[] = {3, 1, 4, 2};
    campaign *c = new_campaign(SAMPLE_FULL, counts, COUNT(counts));
    assert_int_equal(c->rows, 24);
    for (uint64_t row = 0; row < c->rows; row++) {
        choice chosen[CAMPAIGN_FACTORS_MAX];
        sample_choose(chosen, c, row);
        assert_int_equal(chosen[0].index, row / 8);
        assert_int_equal(chosen[1].index, 0);
        assert_int_equal(chosen[2].index, row / 2 % 4);
        assert_int_equal(chosen[3].index, row % 2);
    }
    free(c);
}

TEST(a_full_product_has_limits)
{
    static const uint64_t counts[] = {UINT64_C(1) << 31, UINT64_C(1) << 31, 2};
    campaign *c = new_campaign(SAMPLE_FULL, counts, 1);
    assert_int_equal(c->rows, UINT64_C(1) << 31);
    c->factor_count = 3;
    c->factors[1] = c->factors[0];
    c->factors[2] = c->factors[0];
    assert_non_null(sample_prepare(c));
    free(c);
}

TEST(pruned_values_are_counted_as_rows)
{
    static const uint64_t counts[] = {4, 5};
    campaign *c = new_campaign(SAMPLE_FULL, counts, 2);
    c->factors[0].pruned = 2;
    c->factors[1].pruned = 1;
    assert_null(sample_prepare(c));
    assert_int_equal(c->rows, 20);
    assert_int_equal(c->pruned, 6 * 6 - 20);
    free(c);
}

/* Returns the value that a draw stands for, of so many. Other versions must draw the same. */
static uint64_t draw_index(const char *name, uint64_t row, uint64_t count)
{
    return (uint64_t)((long double)cw_random(5, name, row) * (long double)count / 0x1p64L);
}

TEST(random_rows_do_not_depend_on_other_factors)
{
    static const uint64_t counts[] = {10, 7, 3};
    campaign *all = new_campaign(SAMPLE_RANDOM, counts, 3);
    campaign *one = new_campaign(SAMPLE_RANDOM, counts, 1);
    assert_int_equal(all->rows, 1000);
    for (uint64_t row = 0; row < 1000; row++) {
        choice a[CAMPAIGN_FACTORS_MAX];
        choice b[CAMPAIGN_FACTORS_MAX];
        sample_choose(a, all, row);
        sample_choose(b, one, row);
        assert_int_equal(a[0].index, b[0].index);
        for (size_t i = 0; i < 3; i++)
            assert_int_equal(a[i].index, draw_index(names[i], row, counts[i]));
    }
    free(all);
    free(one);
}

/* Returns the distance of two places on a circle of length 1. */
static double distance(double a, double b)
{
    const double way = fabs(a - b);
    return way < 0.5 ? way : 1 - way;
}

/* Roberts: factor i of d goes on by root^-(i + 1), from a place that is drawn. An index is the
 * place on a circle of steps. */
TEST(low_discrepancy_is_the_sequence_of_roberts)
{
    static const uint64_t counts[] = {1000000, 1000000, 1000000, 1000000};
    for (size_t d = 1; d <= COUNT(roots); d++) {
        campaign *c = new_campaign(SAMPLE_LOW_DISCREPANCY, counts, d);
        for (uint64_t row = 0; row < 1000; row++) {
            choice chosen[CAMPAIGN_FACTORS_MAX];
            sample_choose(chosen, c, row);
            for (size_t i = 0; i < d; i++) {
                const double way = (double)(row + 1) * pow(roots[d - 1], -(double)(i + 1));
                const double place = (double)draw_index(names[i], 0, counts[i]) / 1e6 + way;
                assert_true(distance(place - floor(place), (double)chosen[i].index / 1e6) < 3e-6);
            }
        }
        free(c);
    }
}

/* The gaps of N multiples of the golden ratio have three lengths at most, the longest of which is
 * below 2.62 / N. */
TEST(low_discrepancy_leaves_no_large_gap)
{
    static const uint64_t count = 233;
    static bool seen[233];
    campaign *c = new_campaign(SAMPLE_LOW_DISCREPANCY, &count, 1);
    unsigned gap = 0;
    unsigned longest = 0;
    for (uint64_t row = 0; row < count; row++) {
        choice chosen[CAMPAIGN_FACTORS_MAX];
        sample_choose(chosen, c, row);
        seen[chosen[0].index] = true;
    }
    for (size_t i = 0; i < 2 * COUNT(seen); i++) {
        gap = seen[i % COUNT(seen)] ? 0 : gap + 1;
        longest = gap > longest ? gap : longest;
    }
    assert_true(longest <= 2);
    free(c);
}

/* ---- Values ---------------------------------------------------------------------------------- */

static int64_t drawn_value(const factor *f, double part)
{
    char text[NUMBER_TEXT_MAX];
    const choice chosen = {.drawn = (uint64_t)(part * 0x1p64)};
    return strtoll(sample_text(text, f, &chosen), NULL, 10);
}

/* Tables of the standard normal distribution. */
TEST(normal_values_are_quantiles)
{
    static const double table[][2] = {
        {0.5, 0}, {0.841344746068543, 1}, {0.158655253931457, -1}, {0.975, 1.959963984540054},
        {0.025, -1.959963984540054}, {0.99, 2.326347874040841}, {0.9986501019683699, 3},
        {0.001, -3.090232306167813}, {0.75, 0.674489750196082}};
    const factor f = {.name = "n", .kind = FACTOR_NORMAL, .from.mantissa = 50,
                      .to.mantissa = 1000000000, .step.mantissa = 1};
    for (size_t i = 0; i < COUNT(table); i++)
        assert_true(fabs((double)(drawn_value(&f, table[i][0]) - 50) - table[i][1] * 1e9) < 20);
}

TEST(normal_values_are_whole_steps)
{
    const factor f = {.name = "n", .kind = FACTOR_NORMAL, .from.mantissa = 0, .to.mantissa = 100,
                      .step.mantissa = 25};
    assert_int_equal(drawn_value(&f, 0.5), 0);
    assert_int_equal(drawn_value(&f, 0.5497), 0);  /* 12.49 */
    assert_int_equal(drawn_value(&f, 0.5498), 25); /* 12.51 */
    assert_int_equal(drawn_value(&f, 0.841344746068543), 100);
    assert_int_equal(drawn_value(&f, 0.1), -125);  /* -128.2 */
}

TEST(uniform_values_have_equal_parts)
{
    const factor f = {.name = "u", .kind = FACTOR_UNIFORM, .from.mantissa = -3, .to.mantissa = 8,
                      .step.mantissa = 5};
    assert_int_equal(drawn_value(&f, 0), -3);
    assert_int_equal(drawn_value(&f, 0.3333), -3);
    assert_int_equal(drawn_value(&f, 0.3334), 2);
    assert_int_equal(drawn_value(&f, 0.6666), 2);
    assert_int_equal(drawn_value(&f, 0.6667), 7);
    assert_int_equal(drawn_value(&f, 0.9999999), 7); /* 12 would be beyond 8 */
}

TEST(ranges_go_by_steps)
{
    const factor f = {.name = "r", .kind = FACTOR_RANGE, .count = 4,
                      .from = {-15, 1, "us"}, .step = {10, 1, "us"}};
    static const char *const expected[] = {"\"-1.5us\"", "\"-0.5us\"", "\"0.5us\"", "\"1.5us\""};
    for (uint64_t i = 0; i < COUNT(expected); i++) {
        char text[NUMBER_TEXT_MAX];
        assert_string_equal(sample_text(text, &f, &(choice){.index = i}), expected[i]);
    }
}
