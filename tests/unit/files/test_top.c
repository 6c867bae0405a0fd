/* SPDX-License-Identifier: MIT
 *
 * test_top.c - canwire top: from the replies of a bus to numbers, and from these to lines.
 */
#include "cases.h"
#include "cli/top/top_layout.h"
#include "cli/top/top_model.h"

#include <inttypes.h>

#define ROWS 24u
#define COLUMNS 80u

static top_model model;
static top_model other;
static top_shown shown[2];
static top_line lines[200];

/* Takes a status of that time, with frames and errors of "engine", and a rule with its hits. */
static void take_of(top_model *m, int pid, int64_t time_ns, int frames, int errors, int hits)
{
    json_error_t error;
    json_t *status = json_pack_ex(
        &error, 0,
        "{s:i,s:{s:s,s:i,s:I,s:i,s:i,s:i,s:i},"
        "s:[{s:s,s:n,s:s,s:i,s:i,s:i,s:i,s:i,s:{s:i}},{s:s,s:s,s:s,s:i,s:i}]}",
        "pid", pid, "bus", "name", "power", "bitrate", 500000, "time_ns", (json_int_t)time_ns,
        "load_second_permille", 432, "frames", frames, "error_frames", errors, "faults", hits,
        "nodes", "name", "engine", "link", "state", "error-passive", "tec", 128, "rec", 0,
        "tx_frames", frames, "rx_frames", 0, "bus_errors", errors, "delay", "max_ns", 12345678,
        "name", "dash", "link", "down", "state", "error-active", "tec", 0, "rec", 96);
    json_auto_t *faults = json_pack("[{s:s,s:s,s:i,s:b,s:b}]", "name", "crc", "action", "flip",
                                    "hits", hits, "manual", 0, "injected", 1);
    assert_non_null(status);
    assert_non_null(faults);
    top_model_take(m, status, faults);
    json_decref(status);
}

static void take(int pid, int64_t time_ns, int frames, int errors, int hits)
{
    take_of(&model, pid, time_ns, frames, errors, hits);
}

static int begin(void **state)
{
    (void)state;
    memset(&model, 0, sizeof model);
    memset(&other, 0, sizeof other);
    shown[0] = (top_shown){.model = &model, .there = true};
    shown[1] = (top_shown){.model = &other, .there = true};
    return 0;
}

/* ---- Numbers --------------------------------------------------------------------------------- */

TEST_WITH(rates_are_in_bus_time, begin, NULL)
{
    take(1, INT64_C(1000000000), 100, 5, 1);
    assert_int_equal(model.frames.value, 100);
    assert_int_equal(model.frames.rate, 0);
    take(1, INT64_C(1500000000), 300, 6, 1); /* half a second */
    assert_int_equal(model.frames.rate, 400000);
    assert_int_equal(model.errors.rate, 2000);
    assert_int_equal(model.nodes[0].tx.rate, 400000);
    assert_int_equal(model.nodes[0].errors.rate, 2000);
    assert_int_equal(model.rules[0].hits.rate, 0);
    take(1, INT64_C(1500000000), 300, 6, 1); /* it stands still */
    assert_int_equal(model.frames.rate, 0);
}

TEST_WITH(a_bus_that_has_begun_anew_has_no_rates_yet, begin, NULL)
{
    take(1, INT64_C(9000000000), 10, 0, 0);
    take(2, INT64_C(10000000000), 300, 6, 1); /* another process */
    assert_int_equal(model.frames.rate, 0);
    take(2, INT64_C(1000000000), 500, 6, 1); /* back in time */
    assert_int_equal(model.frames.rate, 0);
    take(2, INT64_C(2000000000), 501, 6, 1);
    assert_int_equal(model.frames.rate, 1000);
}

TEST_WITH(a_node_without_link_says_so, begin, NULL)
{
    take(1, 0, 0, 0, 0);
    assert_string_equal(model.nodes[0].state, "error-passive");
    assert_string_equal(model.nodes[1].state, "link down");
    assert_true(model.rules[0].injected);
    assert_string_equal(model.rules[0].state, "waiting");
}

/* ---- Lines ----------------------------------------------------------------------------------- */

static top_view view_of(unsigned buses)
{
    return (top_view){.buses = shown, .bus_count = buses, .selected = TOP_NONE};
}

TEST_WITH(the_lines_of_a_bus, begin, NULL)
{
    const top_view view = view_of(1);
    take(1, INT64_C(1000000000), 100, 5, 0);
    take(1, INT64_C(2000000000), 4021, 7, 3);
    assert_int_equal(top_layout(lines, ROWS, COLUMNS, &view), ROWS);
    static const char *const expected[] = {
        " BUS               BIT/S LOAD%                FRAMES/S ERRORS/S  WORST DLY",
        " power            500000  43.2 [######      ]     3921      2.0    12.3 ms",
        "",
        " NODE       STATE         TEC            REC           TX/S  RX/S ERR/S    WORST",
        " engine     error-passive 128 [####   ]   0 [       ]  3921     0   2.0  12.3 ms",
        " dash       link down       0 [       ]  96 [###    ]     0     0     0        -",
        " RULE                     ACTION       STATE          HITS  HITS/S  FROM",
        " crc                      flip         waiting           3     3.0  injected",
    };
    for (unsigned i = 0; i < sizeof expected / sizeof expected[0]; i++)
        assert_string_equal(lines[i].text, expected[i]);
    assert_int_equal(lines[1].style, TOP_DEAD); /* a node has no link */
    assert_int_equal(lines[4].style, TOP_SERIOUS);
    assert_int_equal(lines[5].style, TOP_DEAD);
    assert_int_equal(lines[7].style, TOP_WARNING);
    assert_memory_equal(lines[ROWS - 1].text, "q quit", 6);
}

TEST_WITH(a_bar_is_full_at_the_most_and_shows_little, begin, NULL)
{
    static const struct {
        int64_t value;
        const char *bar;
    } cases[] = {{0, "[    ]"}, {1, "[#   ]"},   {64, "[#   ]"},  {65, "[##  ]"},
                 {255, "[####]"}, {256, "[####]"}, {400, "[####]"}, {-1, "[    ]"}};
    char bar[7];
    for (unsigned i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        top_bar(bar, 4, cases[i].value, 256);
        assert_string_equal(bar, cases[i].bar);
    }
}

TEST_WITH(of_several_buses_one_is_marked, begin, NULL)
{
    top_view view = view_of(2);
    take(1, 1, 0, 0, 0);
    take_of(&other, 1, 1, 0, 0, 0);
    strcpy(other.name, "body");
    view.bus = 1;
    view.paused = true;
    (void)top_layout(lines, ROWS, COLUMNS, &view);
    assert_non_null(strstr(lines[0].text, "PAUSED"));
    assert_memory_equal(lines[1].text, " power", 6);
    assert_memory_equal(lines[2].text, ">body", 5);
}

TEST_WITH(a_bus_that_is_gone_says_so, begin, NULL)
{
    const top_view view = view_of(1);
    take(1, 1, 0, 0, 0);
    shown[0].there = false;
    (void)top_layout(lines, ROWS, COLUMNS, &view);
    assert_string_equal(lines[1].text, " power           "
                                        "is gone, with these last numbers; asks again");
    assert_int_equal(lines[1].style, TOP_DEAD);
    assert_memory_equal(lines[4].text, " engine", 7);
}

/* Every row can be reached on a small screen, and nothing is written beyond it. */
TEST_WITH(the_selected_row_is_seen_on_every_screen, begin, NULL)
{
    top_view view = view_of(1);
    take(1, 1, 0, 0, 0);
    for (unsigned rows = TOP_ROWS_MIN; rows <= ROWS; rows++)
        for (unsigned columns = TOP_COLUMNS_MIN; columns <= 200; columns += 7)
            for (view.selected = 0; view.selected < 3; view.selected++) {
                unsigned seen = 0;
                memset(lines, 'x', sizeof lines);
                assert_int_equal(top_layout(lines, rows, columns, &view), rows);
                for (unsigned i = 0; i < rows; i++) {
                    assert_true(strlen(lines[i].text) <= columns);
                    seen += lines[i].selected;
                }
                assert_int_equal(seen, 1);
                assert_int_equal(lines[rows].text[0], 'x');
            }
}

/* A small screen has room for some of the five rows: two heads, two nodes and a rule. */
TEST_WITH(rows_without_room_are_told, begin, NULL)
{
    top_view view = view_of(1);
    take(1, 1, 0, 0, 0);
    (void)top_layout(lines, 8, COLUMNS, &view);
    assert_string_equal(lines[2].text, " lines 1 to 4 of 5: Up and Down show the others");
    view.selected = 2;
    (void)top_layout(lines, 8, COLUMNS, &view);
    assert_string_equal(lines[2].text, " lines 2 to 5 of 5: Up and Down show the others");
    (void)top_layout(lines, 9, COLUMNS, &view);
    assert_string_equal(lines[2].text, "");
}

TEST_WITH(long_names_keep_both_ends, begin, NULL)
{
    const top_view view = view_of(1);
    take(1, 1, 0, 0, 0);
    strcpy(model.nodes[0].name, "window-lifter-17");
    (void)top_layout(lines, ROWS, COLUMNS, &view);
    assert_memory_equal(lines[4].text, " wind..r-17 error", 17);
    (void)top_layout(lines, ROWS, COLUMNS + 20, &view);
    assert_memory_equal(lines[4].text, " window-lifter-17 ", 18);
}

TEST_WITH(what_is_too_small_says_what_it_needs, begin, NULL)
{
    const top_view view = view_of(1);
    assert_int_equal(top_layout(lines, TOP_ROWS_MIN - 1, COLUMNS, &view), 1);
    assert_string_equal(lines[0].text, "needs 40 x 8");
    assert_int_equal(top_layout(lines, ROWS, 5, &view), 1);
    assert_string_equal(lines[0].text, "needs");
    assert_int_equal(top_layout(lines, 0, 0, &view), 0);
}

TEST_WITH(the_help_has_all_keys, begin, NULL)
{
    top_view view = view_of(1);
    view.help = true;
    view.message = "injected";
    assert_int_equal(top_layout(lines, ROWS, COLUMNS, &view), ROWS);
    assert_memory_equal(lines[3].text, "  i  ", 5);
    assert_string_equal(lines[ROWS - 1].text, "injected");
}
