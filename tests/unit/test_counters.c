/* SPDX-License-Identifier: MIT
 *
 * test_counters.c - the tables of counters: their values, and rows that fit together.
 */

#include "cases.h"
#include "port/port.h"

static const cw_stat *const tables[] = {cw_node_counters, cw_bus_counters, cw_host_counters,
                                        cw_sleep_counters, port_counters};
#define TABLES (sizeof tables / sizeof *tables)

static const cw_stat *find(const cw_stat *table, const char *name)
{
    while (table->name && strcmp(table->name, name) != 0)
        table++;
    assert_non_null(table->name);
    return table;
}

TEST(values_are_those_of_the_members)
{
    const cw_node_stats s = {.tx_frames = UINT64_MAX, .restarts = UINT32_MAX, .queue = UINT16_MAX,
                             .dropped = {[CW_DROP_SLOT_MISSED] = 3, [CW_DROP_FAULT] = 4},
                             .errors = {[CW_ERROR_BIT] = 5, [CW_ERROR_ACK] = 6}};
    const cw_stat *dropped = find(cw_node_counters, "dropped");
    const cw_stat *errors = find(cw_node_counters, "errors");

    assert_true(cw_stat_value(find(cw_node_counters, "tx_frames"), &s, 0) == UINT64_MAX);
    assert_int_equal(cw_stat_value(find(cw_node_counters, "restarts"), &s, 0), UINT32_MAX);
    assert_int_equal(cw_stat_value(find(cw_node_counters, "queue"), &s, 0), UINT16_MAX);
    assert_int_equal(cw_stat_value(find(cw_node_counters, "queue_peak"), &s, 0), 0);
    assert_int_equal(dropped->count, CW_DROP_COUNT);
    assert_int_equal(cw_stat_value(dropped, &s, CW_DROP_SLOT_MISSED), 3);
    assert_string_equal(cw_stat_word(dropped, CW_DROP_SLOT_MISSED), "slot-missed");
    assert_int_equal(cw_stat_sum(dropped, &s), 7);
    assert_int_equal(errors->count, CW_ERROR_COUNT);
    assert_string_equal(cw_stat_word(errors, CW_ERROR_ACK), "ack");
    assert_int_equal(cw_stat_sum(find(cw_node_counters, "bus_errors"), &s), 11);
    assert_int_equal(find(cw_bus_counters, "error_rate_ppm")->count, 0);
}

TEST(rows_have_all_that_outputs_need)
{
    for (size_t t = 0; t < TABLES; t++)
        for (const cw_stat *c = tables[t]; c->name; c++) {
            assert_ptr_equal(find(tables[t], c->name), c);
            assert_true(strlen(c->sentence) > 0);
            assert_true(strlen(cw_unit_name(c->unit)) > 0);
            assert_int_equal(c->line != CW_LINE_NONE, c->title != NULL);
            assert_true(c->line == CW_LINE_NONE || c->shown != CW_STAT_CODE);
        }
}

/* A place that two counters have would leave their order to chance. */
TEST(places_of_columns_are_given_once)
{
    uint64_t given[CW_LINE_HOST + 1] = {0};

    for (size_t t = 0; t < TABLES; t++)
        for (const cw_stat *c = tables[t]; c->name; c++) {
            assert_false(c->line != CW_LINE_NONE && (given[c->line] >> c->place & 1u));
            given[c->line] |= UINT64_C(1) << c->place;
        }
    for (unsigned line = CW_LINE_LINK; line <= CW_LINE_HOST; line++) {
        assert_true(given[line] != 0);
        assert_true((given[line] & (given[line] + 1)) == 0);
    }
}
