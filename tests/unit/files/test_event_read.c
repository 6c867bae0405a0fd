/* SPDX-License-Identifier: MIT
 *
 * test_event_read.c - lines of events become the events again that they were written from.
 */
#include "cases.h"
#include "record/event_read.h"
#include "record/output.h"

#define TICK 160160u
#define ENGINE 0x1u
#define GEARBOX 0x2u

static char engine[] = "engine";
static char gearbox[] = "gearbox";
static char bus_name[] = "bus";
static cfg_node nodes[] = {{.name = engine}, {.name = gearbox}};
static const cfg config = {.bus_name = bus_name, .node_count = 2, .nodes = nodes};

static const cw_frame frame = {.id = 0x123, .dlc = 2, .data = {0xCA, 0xFE}};
static const cw_frame fd_frame = {.id = 0x1FFFFFFF,
                                  .flags = CW_FRAME_EXTENDED | CW_FRAME_FD | CW_FRAME_BRS,
                                  .dlc = 15,
                                  .data = {0xCA, [63] = 0xFE}};

static event_read_result read_text(cw_event *out, uint64_t *time_ns, const char *text)
{
    json_error_t error;
    json_auto_t *line = json_loads(text, 0, &error);
    assert_non_null(line);
    event_read_result result = event_read(out, time_ns, line, &config);
    return result;
}

/* Writes, reads and writes an event again: the line must be the same. */
static void check(const cw_event *event)
{
    char *lines[2] = {NULL, NULL};
    cw_event now = *event;
    uint64_t time_ns = 0;
    for (unsigned i = 0; i < 2; i++) {
        size_t size;
        FILE *out = open_memstream(&lines[i], &size);
        assert_non_null(out);
        output_event(out, &config, &now);
        assert_int_equal(fclose(out), 0);
        assert_int_equal(read_text(&now, &time_ns, lines[i]), EVENT_READ);
        assert_int_equal(time_ns, TICK / 2 * 25);
        assert_int_equal(now.tick, TICK);
        assert_int_equal(now.kind, event->kind);
        now.error.flag = event->error.flag; /* the line contains it, but no receiver of events needs
                                               it */
        now.error.place.extended = event->error.place.extended;
    }
    assert_string_equal(lines[0], lines[1]);
    free(lines[0]);
    free(lines[1]);
}

TEST(test_errors_of_each_type_in_each_field)
{
    for (unsigned type = 0; type < CW_ERROR_COUNT; type++)
        for (unsigned field = 0; field < CW_FIELD_COUNT; field++) {
            const uint16_t index = field == CW_FIELD_DATA ? 511 : 3;
            for (unsigned stuff = 0; stuff < 2; stuff++)
                check(&(cw_event){.tick = TICK,
                                  .kind = CW_EVENT_ERROR,
                                  .nodes = GEARBOX,
                                  .tec = 8,
                                  .rec = 1,
                                  .error = {.role = stuff ? CW_ROLE_TRANSMITTER : CW_ROLE_RECEIVER,
                                            .type = (cw_error_type)type,
                                            .place = {.field = (cw_field)field,
                                                      .index = index,
                                                      .stuff = stuff != 0}}});
        }
}

TEST(test_the_rate_at_which_an_error_is_found)
{
    for (unsigned fast = 0; fast < 2; fast++) {
        const cw_event event = {.tick = TICK,
                                .kind = CW_EVENT_ERROR,
                                .nodes = GEARBOX,
                                .fast = fast != 0,
                                .error = {.role = CW_ROLE_RECEIVER,
                                          .type = CW_ERROR_STUFF,
                                          .place = {.field = CW_FIELD_DATA}}};
        check(&event);
    }
    cw_event read;
    uint64_t time_ns;
    assert_int_equal(read_text(&read, &time_ns,
                               "{\"t\":1,\"node\":\"engine\",\"event\":\"error\",\"type\":\"bit\","
                               "\"field\":\"data\",\"index\":3,\"rate\":\"data\"}"),
                     EVENT_READ);
    assert_true(read.fast);
}

TEST(test_each_state_and_each_reason_of_a_drop)
{
    for (unsigned to = 0; to < CW_STATE_COUNT; to++)
        check(&(cw_event){.tick = TICK,
                          .kind = CW_EVENT_STATE,
                          .nodes = ENGINE,
                          .state = (uint8_t)to,
                          .tec = 256,
                          .rec = 128});
    check(&(cw_event){.tick = TICK, .kind = CW_EVENT_STATE, .nodes = ENGINE,
                      .state_before = CW_STATE_SLEEPING});
    for (unsigned by = 0; by < CW_WAKE_COUNT; by++)
        check(&(cw_event){.tick = TICK, .kind = CW_EVENT_WAKE, .nodes = ENGINE,
                          .why = (uint8_t)by});
    for (unsigned why = 0; why < CW_DROP_COUNT; why++)
        check(&(cw_event){.tick = TICK,
                          .kind = CW_EVENT_DROP,
                          .nodes = ENGINE,
                          .frame = frame,
                          .why = (uint8_t)why});
}

TEST(test_frames_restarts_and_time_that_is_skipped)
{
    const cw_event_kind kinds[] = {CW_EVENT_RX, CW_EVENT_TX, CW_EVENT_ARBITRATION_LOST,
                                   CW_EVENT_RESTART, CW_EVENT_OVERLOAD, CW_EVENT_EXCEPTION,
                                   CW_EVENT_OVERRUN, CW_EVENT_IMPROPER};
    for (size_t i = 0; i < sizeof kinds / sizeof kinds[0]; i++)
        check(&(cw_event){.tick = TICK,
                          .kind = kinds[i],
                          .nodes = GEARBOX,
                          .frame = frame,
                          .lost_bit = 11});
    for (size_t i = 0; i < 3; i++)
        check(&(cw_event){.tick = TICK,
                          .kind = kinds[i],
                          .nodes = GEARBOX,
                          .frame = fd_frame,
                          .lost_bit = 11});
    check(&(cw_event){.tick = TICK, .kind = CW_EVENT_SKIP, .ticks = 80000000});
}

TEST(test_what_is_not_understood_is_no_event)
{
    static const struct {
        const char *text;
        event_read_result result;
    } cases[] = {
        {"{\"t\":1,\"node\":\"dash\",\"event\":\"restart\"}", EVENT_NO_SUCH_NODE},
        {"{\"t\":1,\"node\":\"engine\",\"event\":\"explosion\"}", EVENT_OTHER},
        {"{\"t\":-1,\"node\":\"engine\",\"event\":\"restart\"}", EVENT_OTHER},
        {"{\"t\":2e9,\"node\":\"engine\",\"event\":\"restart\"}", EVENT_OTHER},
        {"{\"t\":1,\"node\":\"engine\",\"event\":\"tx\",\"frame\":\"hello\"}", EVENT_OTHER},
        {"{\"t\":1,\"node\":\"engine\",\"event\":\"state\",\"state\":\"tired\"}", EVENT_OTHER},
        {"{\"t\":1,\"node\":\"engine\",\"event\":\"drop\",\"frame\":\"1#\",\"why\":\"rain\"}",
         EVENT_OTHER},
        {"{\"t\":1,\"node\":\"engine\",\"event\":\"drop\",\"frame\":\"001#\",\"why\":\"rain\"}",
         EVENT_OTHER},
        {"{\"t\":1,\"node\":\"engine\",\"event\":\"error\",\"type\":\"odd\",\"field\":\"crc\"}",
         EVENT_OTHER},
        {"{\"t\":1,\"node\":\"engine\",\"event\":\"error\",\"type\":\"crc\",\"field\":\"tail\"}",
         EVENT_OTHER},
        {"[1, 2]", EVENT_OTHER},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        cw_event event;
        uint64_t time_ns;
        assert_int_equal(read_text(&event, &time_ns, cases[i].text), cases[i].result);
    }
}
