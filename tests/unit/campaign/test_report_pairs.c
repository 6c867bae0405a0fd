/* SPDX-License-Identifier: MIT
 *
 * test_report_pairs.c - which pairs of values rows have in a report, and the classes of these rows.
 */
#include "cases.h"
#include "campaign/report/pairs.h"

/* ---- Cells ----------------------------------------------------------------------------------- */

TEST(test_each_pair_of_numbers_has_a_cell_of_its_own)
{
    enum { SIDE = 100 };
    static const uint32_t steps[] = {1, 64, 4096, 65536, 0x01000000};
    for (size_t s = 0; s < sizeof steps / sizeof steps[0]; s++) {
        crosstab t = {.count = 0};
        for (uint32_t i = 0; i < SIDE * SIDE; i++) {
            const uint32_t first = i / SIDE * steps[s];
            const uint32_t second = i % SIDE * steps[s];
            assert_null(crosstab_find(&t, first, second));
            crosstab_add(&t, first, second)->of[CLASS_DEGRADED] = i + 1;
        }
        assert_int_equal(t.count, SIDE * SIDE);
        for (uint32_t i = 0; i < SIDE * SIDE; i++) {
            const class_counts *c = crosstab_find(&t, i / SIDE * steps[s], i % SIDE * steps[s]);
            assert_non_null(c);
            assert_int_equal(c->of[CLASS_DEGRADED], i + 1);
        }
        crosstab_free(&t);
    }
}

TEST(test_cells_are_sorted_by_both_numbers)
{
    static const uint32_t added[][2] = {{7, 1}, {0, 9}, {UINT32_MAX - 1, 0}, {7, 0}, {0, 2}};
    static const uint32_t sorted[][2] = {{0, 2}, {0, 9}, {7, 0}, {7, 1}, {UINT32_MAX - 1, 0}};
    crosstab t = {.count = 0};
    free(crosstab_sorted(&t));
    for (size_t i = 0; i < 5; i++)
        (void)crosstab_add(&t, added[i][0], added[i][1]);
    const crosstab_cell **list = crosstab_sorted(&t);
    for (size_t i = 0; i < 5; i++) {
        assert_int_equal(list[i]->first, sorted[i][0]);
        assert_int_equal(list[i]->second, sorted[i][1]);
    }
    free(list);
    crosstab_free(&t);
}

/* ---- Pairs ----------------------------------------------------------------------------------- */

/* Returns the rows of all classes that a pair of factors has. */
static uint64_t rows_of(const pair_cover *c)
{
    uint64_t sum = class_counts_all(&c->classes.other);
    for (size_t i = 0; i < c->classes.count; i++)
        sum += class_counts_all(&c->classes.cells[i].rows);
    return sum;
}

static void add_pair(pairs *p, uint32_t first, uint32_t second, row_class class)
{
    const uint32_t values[CAMPAIGN_FACTORS_MAX] = {first, second};
    pairs_add(p, values, class);
}

TEST(test_rows_are_counted_by_class_for_each_pair_of_factors)
{
    static const struct {
        uint32_t values[3];
        row_class class;
    } rows[] = {
        {{0, 0, 5}, CLASS_NO_EFFECT}, {{0, 0, 6}, CLASS_UNDETECTED}, {{0, 1, 5}, CLASS_UNDETECTED},
        {{0, 0, 5}, CLASS_CRASHED},   {{1, 0, 5}, CLASS_DETECTED},
    };
    static const struct {
        size_t i;
        size_t k;
        uint32_t first;
        uint32_t second;
        row_class class;
        uint64_t count; /* of this class */
        uint64_t all;
    } cells[] = {
        {0, 1, 0, 0, CLASS_NO_EFFECT, 1, 3}, {0, 1, 0, 0, CLASS_UNDETECTED, 1, 3},
        {0, 1, 0, 0, CLASS_CRASHED, 1, 3},   {0, 1, 0, 1, CLASS_UNDETECTED, 1, 1},
        {0, 2, 0, 5, CLASS_UNDETECTED, 1, 3}, {0, 2, 1, 5, CLASS_DETECTED, 1, 1},
        {1, 2, 0, 5, CLASS_DETECTED, 1, 3},  {1, 2, 0, 5, CLASS_UNDETECTED, 0, 3},
    };
    pairs p;
    pairs_begin(&p, 3);
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        uint32_t values[CAMPAIGN_FACTORS_MAX] = {0};
        memcpy(values, rows[i].values, sizeof rows[i].values);
        pairs_add(&p, values, rows[i].class);
    }
    for (size_t i = 0; i < sizeof cells / sizeof cells[0]; i++) {
        const pair_cover *c = pairs_of(&p, cells[i].i, cells[i].k);
        const class_counts *rows_there = crosstab_find(&c->classes, cells[i].first,
                                                       cells[i].second);
        assert_non_null(rows_there);
        assert_int_equal(rows_there->of[cells[i].class], cells[i].count);
        assert_int_equal(class_counts_all(rows_there), cells[i].all);
        assert_int_equal(rows_of(c), 5);
        assert_int_equal(c->met, c->classes.count);
    }
    assert_null(crosstab_find(&pairs_of(&p, 0, 1)->classes, 1, 1));
    pairs_free(&p);
}

TEST(test_values_beyond_a_limit_are_counted_together)
{
    pairs p;
    pairs_begin(&p, 2);
    add_pair(&p, DIMENSION_OTHER, 1, CLASS_DEGRADED);
    add_pair(&p, 1, DIMENSION_OTHER, CLASS_DETECTED);
    add_pair(&p, PAIRS_VALUES_MAX, 1, CLASS_DETECTED); /* it has a cell, but no bit */
    const pair_cover *c = pairs_of(&p, 0, 1);
    assert_true(c->over);
    assert_int_equal(c->classes.count, 1);
    assert_int_equal(c->classes.other.of[CLASS_DEGRADED], 1);
    assert_int_equal(c->classes.other.of[CLASS_DETECTED], 1);
    assert_int_equal(crosstab_find(&c->classes, PAIRS_VALUES_MAX, 1)->of[CLASS_DETECTED], 1);
    pairs_free(&p);
}

TEST(test_a_pair_of_factors_has_so_many_cells_at_most)
{
    enum { SIDE = 300 };
    pairs p;
    pairs_begin(&p, 2);
    for (unsigned round = 0; round < 2; round++)
        for (uint32_t i = 0; i < SIDE * SIDE; i++)
            add_pair(&p, i / SIDE, i % SIDE, CLASS_CORRECTED);
    const pair_cover *c = pairs_of(&p, 0, 1);
    assert_int_equal(c->classes.count, PAIRS_CELLS_MAX);
    assert_int_equal(c->met, SIDE * SIDE); /* all that have met are known */
    assert_int_equal(class_counts_all(&c->classes.other), 2 * (SIDE * SIDE - PAIRS_CELLS_MAX));
    assert_int_equal(crosstab_find(&c->classes, 0, 0)->of[CLASS_CORRECTED], 2);
    pairs_free(&p);
}

TEST(test_large_pairs_of_factors_leave_cells_to_small_ones)
{
    enum { FACTORS = 10, PAIRS = FACTORS * (FACTORS - 1) / 2, ROWS = 4000 };
    size_t cells = 0;
    pairs p;
    pairs_begin(&p, FACTORS);
    for (uint32_t i = 0; i < ROWS; i++) { /* each row has new values, at last also of the first */
        uint32_t values[CAMPAIGN_FACTORS_MAX] = {0};
        for (size_t k = 0; k < FACTORS; k++)
            values[k] = k > 1 || i >= ROWS / 2 ? i : 0;
        pairs_add(&p, values, CLASS_NO_EFFECT);
    }
    for (size_t i = 0; i < FACTORS; i++) {
        for (size_t k = i + 1; k < FACTORS; k++) {
            const pair_cover *c = pairs_of(&p, i, k);
            assert_true(c->classes.count >= PAIRS_CELLS_EACH / PAIRS);
            assert_int_equal(rows_of(c), ROWS);
            cells += c->classes.count;
        }
    }
    assert_in_range(cells, PAIRS_CELLS_MORE, PAIRS_CELLS_EACH + PAIRS_CELLS_MORE);
    assert_true(class_counts_all(&pairs_of(&p, 2, 3)->classes.other) > 0);
    pairs_free(&p);
}
