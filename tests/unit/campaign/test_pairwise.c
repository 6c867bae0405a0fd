/* SPDX-License-Identifier: MIT
 *
 * test_pairwise.c - each two values of different factors meet in a row, and the rows are few.
 */
#include "cases.h"
#include "campaign/space/pairwise.h"

static campaign *new_campaign(const uint64_t *counts, size_t factors)
{
    campaign *c = calloc(1, sizeof *c);
    assert_non_null(c);
    c->sample = SAMPLE_PAIRWISE;
    c->factor_count = factors;
    for (size_t i = 0; i < factors; i++)
        c->factors[i] = (factor){.name = "f", .kind = FACTOR_RANGE, .count = counts[i]};
    return c;
}

static void free_campaign(campaign *c)
{
    free(c->pairs);
    free(c);
}

/* Returns the number of pairs of two factors that meet. */
static uint64_t count_pairs(const campaign *c, size_t a, size_t b)
{
    bool *met = calloc(c->factors[a].count * c->factors[b].count, sizeof *met);
    uint64_t count = 0;
    assert_non_null(met);
    for (uint64_t row = 0; row < c->rows; row++) {
        const uint32_t *values = &c->pairs[row * c->factor_count];
        assert_true(values[a] < c->factors[a].count && values[b] < c->factors[b].count);
        bool *pair = &met[values[a] * c->factors[b].count + values[b]];
        count += !*pair;
        *pair = true;
    }
    free(met);
    return count;
}

/* Returns the least number that any rows could be: the product of the two largest factors. */
static uint64_t least_rows(const campaign *c)
{
    uint64_t least = 0;
    for (size_t a = 0; a < c->factor_count; a++)
        for (size_t b = a + 1; b < c->factor_count; b++)
            if (c->factors[a].count * c->factors[b].count > least)
                least = c->factors[a].count * c->factors[b].count;
    return least;
}

/* Asserts that all pairs meet in at most so many rows. */
static void assert_covers(const uint64_t *counts, size_t factors, uint64_t rows_max)
{
    campaign *c = new_campaign(counts, factors);
    assert_null(pairwise_prepare(c));
    for (size_t a = 0; a < factors; a++)
        for (size_t b = a + 1; b < factors; b++)
            assert_int_equal(count_pairs(c, a, b), counts[a] * counts[b]);
    assert_true(c->rows >= least_rows(c) && c->rows <= rows_max);
    free_campaign(c);
}

TEST(each_pair_meets_in_few_rows)
{
    static const uint64_t two[] = {2, 2, 2};
    static const uint64_t switches[] = {2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2};
    static const uint64_t threes[] = {3, 3, 3, 3};
    static const uint64_t mixed[] = {5, 4, 3, 2};
    static const uint64_t single[] = {1, 7, 1, 3};
    assert_covers(two, COUNT(two), 6);            /* 4 of 8 are possible */
    assert_covers(switches, COUNT(switches), 14); /* of 8192 */
    assert_covers(threes, COUNT(threes), 15);     /* 9 of 81 are possible */
    assert_covers(mixed, COUNT(mixed), 28);       /* of 120 */
    assert_covers(single, COUNT(single), 21);
    assert_covers(mixed, 2, 20);
}

TEST(each_pair_meets_whatever_the_factors_are)
{
    for (uint64_t i = 0; i < 40; i++) {
        uint64_t counts[8];
        uint64_t product = 1;
        const size_t factors = 2 + cw_random(3, "factors", i) % 7;
        for (size_t k = 0; k < factors; k++)
            product *= counts[k] = 1 + cw_random(3, "values", 8 * i + k) % 9;
        assert_covers(counts, factors, product < 400 ? product : 400);
    }
}

TEST(one_factor_has_its_values_as_rows)
{
    static const uint64_t count = 5;
    campaign *c = new_campaign(&count, 1);
    assert_null(pairwise_prepare(c));
    assert_int_equal(c->rows, 5);
    for (uint32_t i = 0; i < 5; i++)
        assert_int_equal(c->pairs[i], i);
    free_campaign(c);
}

TEST(too_many_values_are_refused)
{
    static const uint64_t most[] = {1999, 1};
    static const uint64_t more[] = {2000, 1};
    static const uint64_t wide[] = {UINT64_C(1) << 33, UINT64_C(1) << 33};
    campaign *c = new_campaign(more, 2);
    assert_covers(most, 2, 1999);
    assert_string_equal(pairwise_prepare(c),
                        "pairwise is for factors with up to 2000 values together");
    free_campaign(c);
    c = new_campaign(wide, 2);
    assert_non_null(pairwise_prepare(c));
    free_campaign(c);
}
