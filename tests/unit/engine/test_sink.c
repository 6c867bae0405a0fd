/* SPDX-License-Identifier: MIT
 *
 * test_sink.c - what the status line says of sinks: first those in trouble, and how many it omits.
 */
#include "cases.h"
#include "base/file/sink.h"

static const sink_info fine = {.kind = SINK_RECORD, .name = "/data/a.log", .state = "recording",
                               .good = true};
static const sink_info full = {.kind = SINK_RECORD, .name = "b.log", .state = "stopped",
                               .why = "No space left on device", .lost = 7};
static const sink_info nobody = {.kind = SINK_LCM, .name = "tcpq://h:1", .state = "failing",
                                 .why = "Connection refused"};

TEST(test_those_in_trouble_come_first)
{
    char text[200];
    sink_list all = {.count = 0};
    sinks_add(&all, &fine);
    sinks_add(&all, &full);
    sinks_add(&all, &nobody);
    assert_int_equal(sinks_print(text, sizeof text, &all), 123);
    assert_string_equal(text, ", record b.log stopped: No space left on device, 7 lost"
                              ", lcm tcpq://h:1 failing: Connection refused"
                              ", record a.log recording");
}

TEST(test_those_without_room_are_counted)
{
    char text[100];
    sink_list all = {.count = 0};
    for (size_t i = 0; i < 2; i++) {
        sinks_add(&all, &full);
        sinks_add(&all, &nobody);
    }
    (void)sinks_print(text, sizeof text, &all);
    assert_string_equal(text, ", record b.log stopped: No space left on device, 7 lost"
                              ", 3 more (3 bad)");
    (void)sinks_print(text, 1 + 30, &all);
    assert_string_equal(text, ", 4 more (4 bad)");
}

TEST(test_none_is_no_text)
{
    char text[4] = "abc";
    const sink_list none = {.count = 0};
    assert_int_equal(sinks_print(text, sizeof text, &none), 0);
    assert_string_equal(text, "");
}
