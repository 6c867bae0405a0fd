/* SPDX-License-Identifier: MIT
 *
 * test_output.c - events as JSON lines, candump logs and statistics, as the contract shows them.
 */
#include "cases.h"
#include "record/output.h"

#include <jansson.h>

#define BIT_TICKS 160u /* 500 kbit/s */
#define EVENT_RING 256
#define ENGINE 0x1u
#define GEARBOX 0x2u
#define LOAD 0x4u

static char engine[] = "engine";
static char gearbox[] = "gear.box_2";
static char load[] = "load";
static char vcan0[] = "vcan0";
static char bus_name[] = "powertrain";

static cfg_node nodes[] = {{.name = engine, .port = vcan0}, {.name = gearbox}, {.name = load}};

/* Acts on the first frame only. */
static cw_rule rules[] = {
    {.name = "never",
     .filters = {{.value = 0x7ff, .mask = 0xdfffffff}},
     .filter_count = 1,
     .time_end = CW_NEVER,
     .probability = UINT64_MAX,
     .field = CW_FIELD_CRC,
     .bits = 1},
    {.name = "crc-flip",
     .time_end = CW_NEVER,
     .count = 1,
     .probability = UINT64_MAX,
     .field = CW_FIELD_CRC,
     .index = 3,
     .bits = 1},
};

static const cfg config = {
    .bus_name = bus_name,
    .bitrate_bps = 500000,
    .rate = {BIT_TICKS},
    .node_count = 3,
    .nodes = nodes,
    .rule_count = 2,
    .rules = rules,
};

static const cw_frame deadbeef = {.id = 0x123, .dlc = 4, .data = {0xde, 0xad, 0xbe, 0xef}};

/* ---- Lines ----------------------------------------------------------------------------------- */

typedef void writer(FILE *out, const cfg *config, const cw_event *event);

typedef struct line_case {
    const char *name;
    writer *write;
    cw_event event;
    const char *text;
} line_case;

#define DEADBEEF                                                                                   \
    {                                                                                              \
        .id = 0x123, .dlc = 4, .data = { 0xde, 0xad, 0xbe, 0xef }                                  \
    }

static const line_case lines[] = {
    {"rx",
     output_event,
     {.tick = 176 * 80, .nodes = GEARBOX, .kind = CW_EVENT_RX, .frame = DEADBEEF},
     "{\"t\":0.000176000,\"node\":\"gear.box_2\",\"event\":\"rx\",\"frame\":\"123#DEADBEEF\"}\n"},
    {"rx of several nodes is a line for each, in their order",
     output_event,
     {.tick = 3, .nodes = LOAD | ENGINE, .kind = CW_EVENT_RX, .frame = {.id = 0x7ff}},
     "{\"t\":0.000000037,\"node\":\"engine\",\"event\":\"rx\",\"frame\":\"7FF#\"}\n"
     "{\"t\":0.000000037,\"node\":\"load\",\"event\":\"rx\",\"frame\":\"7FF#\"}\n"},
    {"tx of an extended remote frame",
     output_event,
     {.tick = 80000000,
      .nodes = LOAD,
      .kind = CW_EVENT_TX,
      .frame = {.id = 0x12345678, .flags = CW_FRAME_EXTENDED | CW_FRAME_REMOTE, .dlc = 4}},
     "{\"t\":1.000000000,\"node\":\"load\",\"event\":\"tx\",\"frame\":\"12345678#R4\"}\n"},
    {"arbitration-lost",
     output_event,
     {.nodes = LOAD,
      .kind = CW_EVENT_ARBITRATION_LOST,
      .frame = {.id = 0x124},
      .lost_bit = 8,
      .tec = 7},
     "{\"t\":0.000000000,\"node\":\"load\",\"event\":\"arbitration-lost\",\"frame\":\"124#\","
     "\"bit\":8}\n"},
    {"error of a receiver",
     output_event,
     {.nodes = GEARBOX,
      .kind = CW_EVENT_ERROR,
      .rec = 1,
      .error = {.type = CW_ERROR_CRC,
                .role = CW_ROLE_RECEIVER,
                .flag = CW_FLAG_ACTIVE,
                .place = {.field = CW_FIELD_ACK_DELIMITER}}},
     "{\"t\":0.000000000,\"node\":\"gear.box_2\",\"event\":\"error\",\"role\":\"rx\","
     "\"type\":\"crc\",\"field\":\"ack-delimiter\",\"index\":0,\"flag\":\"active\",\"tec\":0,"
     "\"rec\":1}\n"},
    {"error of a transmitter at a stuff bit",
     output_event,
     {.nodes = ENGINE,
      .kind = CW_EVENT_ERROR,
      .tec = 256,
      .rec = 2,
      .error = {.type = CW_ERROR_STUFF,
                .role = CW_ROLE_TRANSMITTER,
                .flag = CW_FLAG_NONE,
                .place = {.field = CW_FIELD_DATA, .index = 23, .stuff = true}}},
     "{\"t\":0.000000000,\"node\":\"engine\",\"event\":\"error\",\"role\":\"tx\","
     "\"type\":\"stuff\",\"field\":\"data\",\"index\":23,\"stuff\":true,\"flag\":\"none\","
     "\"tec\":256,\"rec\":2}\n"},
    {"error at the data rate",
     output_event,
     {.nodes = ENGINE,
      .kind = CW_EVENT_ERROR,
      .fast = true,
      .tec = 8,
      .error = {.type = CW_ERROR_FORM,
                .role = CW_ROLE_TRANSMITTER,
                .flag = CW_FLAG_ACTIVE,
                .place = {.field = CW_FIELD_FIXED_STUFF, .index = 5, .stuff = true}}},
     "{\"t\":0.000000000,\"node\":\"engine\",\"event\":\"error\",\"role\":\"tx\","
     "\"type\":\"form\",\"field\":\"fixed-stuff\",\"index\":5,\"stuff\":true,\"rate\":\"data\","
     "\"flag\":\"active\",\"tec\":8,\"rec\":0}\n"},
    {"protocol exception",
     output_event,
     {.nodes = GEARBOX, .kind = CW_EVENT_EXCEPTION},
     "{\"t\":0.000000000,\"node\":\"gear.box_2\",\"event\":\"protocol-exception\"}\n"},
    {"improper arbitration",
     output_event,
     {.nodes = LOAD,
      .kind = CW_EVENT_IMPROPER,
      .frame = {.id = 0x124},
      .pending = 0x123 | CW_FILTER_EXTENDED,
      .from = GEARBOX},
     "{\"t\":0.000000000,\"node\":\"load\",\"event\":\"improper-arbitration\",\"frame\":\"124#\","
     "\"pending\":\"00000123\",\"pending_node\":\"gear.box_2\"}\n"},
    {"overrun",
     output_event,
     {.nodes = GEARBOX, .kind = CW_EVENT_OVERRUN, .frame = {.id = 0x123}},
     "{\"t\":0.000000000,\"node\":\"gear.box_2\",\"event\":\"overrun\",\"frame\":\"123#\"}\n"},
    {"tx of the longest frame, with flags",
     output_event,
     {.tick = 80,
      .nodes = LOAD,
      .kind = CW_EVENT_TX,
      .frame = {.id = 0x1FFFFFFF,
                .flags = CW_FRAME_EXTENDED | CW_FRAME_FD | CW_FRAME_BRS | CW_FRAME_ESI,
                .dlc = 15,
                .data = {0xDE, [63] = 0xEF}}},
     "{\"t\":0.000001000,\"node\":\"load\",\"event\":\"tx\",\"frame\":\"1FFFFFFF##3DE"
     "00000000000000000000000000000000000000000000000000000000000000"
     "00000000000000000000000000000000000000000000000000000000000000EF\"}\n"},
    {"state",
     output_event,
     {.nodes = ENGINE, .kind = CW_EVENT_STATE, .state = CW_STATE_BUS_OFF, .tec = 256},
     "{\"t\":0.000000000,\"node\":\"engine\",\"event\":\"state\",\"state\":\"bus-off\","
     "\"tec\":256,\"rec\":0}\n"},
    {"awake again",
     output_event,
     {.nodes = ENGINE, .kind = CW_EVENT_STATE, .state_before = CW_STATE_SLEEPING, .rec = 3},
     "{\"t\":0.000000000,\"node\":\"engine\",\"event\":\"state\",\"state\":\"error-active\","
     "\"tec\":0,\"rec\":3,\"was\":\"sleeping\"}\n"},
    {"wake",
     output_event,
     {.nodes = ENGINE, .kind = CW_EVENT_WAKE, .why = CW_WAKE_FRAME},
     "{\"t\":0.000000000,\"node\":\"engine\",\"event\":\"wake\",\"by\":\"frame\"}\n"},
    {"restart",
     output_event,
     {.nodes = ENGINE, .kind = CW_EVENT_RESTART},
     "{\"t\":0.000000000,\"node\":\"engine\",\"event\":\"restart\"}\n"},
    {"overload",
     output_event,
     {.nodes = ENGINE, .kind = CW_EVENT_OVERLOAD},
     "{\"t\":0.000000000,\"node\":\"engine\",\"event\":\"overload\"}\n"},
    {"drop",
     output_event,
     {.nodes = ENGINE, .kind = CW_EVENT_DROP, .why = CW_DROP_QUEUE_FULL, .frame = {.id = 1}},
     "{\"t\":0.000000000,\"node\":\"engine\",\"event\":\"drop\",\"frame\":\"001#\","
     "\"why\":\"queue-full\"}\n"},
    {"fault",
     output_event,
     {.kind = CW_EVENT_FAULT, .rule = 1, .hit = 4294967295u},
     "{\"t\":0.000000000,\"event\":\"fault\",\"rule\":\"crc-flip\",\"hit\":4294967295}\n"},
    {"link",
     output_event,
     {.nodes = ENGINE, .kind = CW_EVENT_LINK},
     "{\"t\":0.000000000,\"node\":\"engine\",\"event\":\"link\",\"state\":\"down\"}\n"},
    {"link that is back",
     output_event,
     {.nodes = ENGINE, .kind = CW_EVENT_LINK, .up = true},
     "{\"t\":0.000000000,\"node\":\"engine\",\"event\":\"link\",\"state\":\"up\"}\n"},
    {"skip",
     output_event,
     {.tick = 80000000, .kind = CW_EVENT_SKIP, .ticks = 3 * 80000000ull},
     "{\"t\":1.000000000,\"event\":\"skip\",\"skipped_ns\":3000000000}\n"},
    {"nodes that are not there write nothing",
     output_event,
     {.nodes = ~UINT64_C(7), .kind = CW_EVENT_RESTART},
     ""},
    {"tolerated writes nothing", output_event, {.nodes = ENGINE, .kind = CW_EVENT_TOLERATED}, ""},
    {"log of a node with port",
     output_log,
     {.tick = 178 * 80, .nodes = ENGINE, .kind = CW_EVENT_TX, .frame = DEADBEEF},
     "(0000000000.000178) vcan0 123#DEADBEEF\n"},
    {"log of a node without port",
     output_log,
     {.tick = 178 * 80, .nodes = LOAD, .kind = CW_EVENT_TX, .frame = DEADBEEF},
     "(0000000000.000178) load 123#DEADBEEF\n"},
    {"log of anything else is empty",
     output_log,
     {.nodes = ENGINE, .kind = CW_EVENT_RX, .frame = DEADBEEF},
     ""},
};

TEST_ROWS(writes_the_line, lines)
{
    const line_case *expected = *state;
    FREED char *text = NULL;
    size_t length = 0;
    FILE *out = open_memstream(&text, &length);

    assert_non_null(out);
    expected->write(out, &config, &expected->event);
    fclose(out);
    assert_string_equal(text, expected->text);
}

/* All nodes there can be, with the longest names: more than is written at once. */
TEST(many_long_lines_are_whole)
{
    static cfg_node many[CW_NODES_MAX];
    static char names[CW_NODES_MAX][33];
    const cfg crowd = {.node_count = CW_NODES_MAX, .nodes = many, .rate = {BIT_TICKS}};
    const cw_event event = {.tick = UINT64_MAX,
                            .nodes = UINT64_MAX,
                            .kind = CW_EVENT_ERROR,
                            .tec = UINT16_MAX,
                            .rec = UINT16_MAX,
                            .error = {.type = CW_ERROR_STUFF,
                                      .role = CW_ROLE_TRANSMITTER,
                                      .place = {.field = CW_FIELD_OVERLOAD_DELIMITER,
                                                .index = UINT8_MAX,
                                                .stuff = true},
                                      .flag = CW_FLAG_PASSIVE}};
    FREED char *text = NULL;
    size_t length = 0;
    FILE *out = open_memstream(&text, &length);

    assert_non_null(out);
    for (unsigned i = 0; i < CW_NODES_MAX; i++) {
        snprintf(names[i], sizeof names[i], "%032u", i);
        many[i].name = names[i];
    }
    output_event(out, &crowd, &event);
    fclose(out);
    const char *line = text;
    for (unsigned i = 0; i < CW_NODES_MAX; i++) {
        char expected[512];
        int expected_length = snprintf(
            expected, sizeof expected,
            "{\"t\":230584300921.369395187,\"node\":\"%032u\",\"event\":\"error\",\"role\":\"tx\","
            "\"type\":\"stuff\",\"field\":\"overload-delimiter\",\"index\":255,\"stuff\":true,"
            "\"flag\":\"passive\",\"tec\":65535,\"rec\":65535}\n",
            i);
        assert_memory_equal(line, expected, (size_t)expected_length);
        line += expected_length;
    }
    assert_int_equal(line - text, length);
}

/* ---- Statistics ------------------------------------------------------------------------------ */

/* Simulates one frame of the engine, hit once by crc-flip, and returns what output_stats wrote.
 * bit_ticks other than BIT_TICKS only to see odd times. */
static json_t *written_stats(uint64_t until_bits, uint32_t bit_ticks)
{
    const cw_node_config each[] = {{.queue = 4, .warning_limit = 96},
                                   {.queue = 4, .warning_limit = 96},
                                   {.queue = 4, .warning_limit = 96}};
    const cw_bus_config wanted = {.bit_ticks = bit_ticks,
                                  .node_count = 3,
                                  .inbox = 4,
                                  .events = EVENT_RING,
                                  .rule_count = 2,
                                  .nodes = each,
                                  .rules = rules};
    FREED void *memory = malloc(cw_bus_size(&wanted));
    cw_bus *bus = cw_bus_init(memory, &wanted);
    FREED char *text = NULL;
    size_t length = 0;
    FILE *out = open_memstream(&text, &length);

    assert_non_null(bus);
    assert_non_null(out);
    assert_int_equal(cw_node_send(bus, 0, &deadbeef, 0), CW_OK);
    assert_int_equal(cw_bus_advance(bus, until_bits * bit_ticks), CW_OK);
    output_stats(out, &config, bus);
    fclose(out);
    json_t *root = json_loads(text, JSON_REJECT_DUPLICATES, NULL);

    assert_non_null(root);
    assert_int_equal(text[length - 1], '\n');
    return root;
}

static void assert_keys(const json_t *object, const char *const *keys)
{
    const char *key;
    json_t *value;

    json_object_foreach((json_t *)(uintptr_t)object, key, value)
    {
        assert_non_null(*keys);
        assert_string_equal(key, *keys);
        keys++;
    }
    assert_null(*keys);
}

/* New keys may stand between them. */
static void assert_keys_in_order(const json_t *object, const char *const *keys)
{
    const char *key;
    json_t *value;

    json_object_foreach((json_t *)(uintptr_t)object, key, value)
    {
        keys += *keys && strcmp(key, *keys) == 0;
    }
    if (*keys) {
        fail_msg("%s is not there, or not in its place", *keys);
    }
}

static json_int_t number(const json_t *object, const char *key)
{
    const json_t *value = json_object_get(object, key);

    assert_true(json_is_integer(value));
    return json_integer_value(value);
}

static const char *string(const json_t *object, const char *key)
{
    const json_t *value = json_object_get(object, key);

    assert_true(json_is_string(value));
    return json_string_value(value);
}

TEST(stats_keys_are_in_order)
{
    static const char *const root_keys[] = {"bus", "nodes", "rules", NULL};
    static const char *const bus_keys[] = {"name",
                                           "bitrate",
                                           "time_ns",
                                           "bits",
                                           "busy_bits",
                                           "load_permille",
                                           "load_second_permille",
                                           "frames",
                                           "frame_bits",
                                           "error_frames",
                                           "error_rate_ppm",
                                           "overload_frames",
                                           "arbitration_lost",
                                           "improper_arbitrations",
                                           "undetected_errors",
                                           "undetected_expected_ppt",
                                           "faults",
                                           "pending",
                                           NULL};
    static const char *const node_keys[] = {"name",
                                            "port",
                                            "state",
                                            "tec",
                                            "rec",
                                            "handed_in",
                                            "made_by_rules",
                                            "tx_frames",
                                            "tx_bytes",
                                            "tx_bits",
                                            "rx_frames",
                                            "rx_bytes",
                                            "rx_accepted",
                                            "rx_made_by_rules",
                                            "dropped",
                                            "rx_dropped",
                                            "arbitration_lost",
                                            "retransmissions",
                                            "errors",
                                            "bus_errors",
                                            "overloads",
                                            "error_warning",
                                            "error_passive",
                                            "bus_off",
                                            "restarts",
                                            "undetected_errors",
                                            "inbox",
                                            "queue",
                                            "queue_peak",
                                            "held",
                                            "rx_held",
                                            "delay",
                                            "synchronisation",
                                            NULL};
    static const char *const drop_keys[] = {"queue-full", "one-shot", "bus-off", "listen-only",
                                            "bad-frame", "fault", "removed", "link-down",
                                            "slot-missed", NULL};
    static const char *const error_keys[] = {"bit", "stuff", "form", "crc", "ack", NULL};
    static const char *const delay_keys[] = {"count",  "min_ns", "mean_ns", "max_ns",
                                             "p50_ns", "p99_ns", NULL};
    static const char *const rule_keys[] = {"name", "matches", "hits", NULL};
    json_auto_t *root = written_stats(300, BIT_TICKS);
    const json_t *node = json_array_get(json_object_get(root, "nodes"), 0);

    assert_keys(root, root_keys);
    assert_keys_in_order(json_object_get(root, "bus"), bus_keys);
    assert_keys_in_order(node, node_keys);
    assert_keys(json_object_get(node, "dropped"), drop_keys);
    assert_keys(json_object_get(node, "errors"), error_keys);
    assert_keys(json_object_get(node, "delay"), delay_keys);
    assert_keys(json_array_get(json_object_get(root, "rules"), 0), rule_keys);
}

TEST(stats_of_the_bus_are_those_of_the_library)
{
    json_auto_t *root = written_stats(300, BIT_TICKS);
    const json_t *bus = json_object_get(root, "bus");

    assert_string_equal(string(bus, "name"), "powertrain");
    assert_int_equal(number(bus, "bitrate"), 500000);
    assert_int_equal(number(bus, "time_ns"), 600000);
    assert_int_equal(number(bus, "bits"), 300);
    assert_int_equal(number(bus, "frames"), 1);
    assert_int_equal(number(bus, "frame_bits"), 78);
    assert_int_equal(number(bus, "error_frames"), 1);
    assert_int_equal(number(bus, "faults"), 1);
    assert_int_equal(number(bus, "load_permille"), number(bus, "busy_bits") * 1000 / 300);
}

/* The CRC is 1(0)00111... on the wire, so crc[3] is wire bit 56, bus bit 11 + 56 = 67. Flipped, it
 * is the fourth dominant bit in a row. The sender's flag is 68 to 73. Its second bit is the sixth
 * dominant one, the receivers' stuff error, and their flag is 70 to 75. Delimiter to 83,
 * intermission to 86; the second attempt takes the 78 bits from 87 to 164: 165 bits of 2 us. */
TEST(stats_of_the_nodes_are_those_of_the_library)
{
    json_auto_t *root = written_stats(300, BIT_TICKS);
    const json_t *all = json_object_get(root, "nodes");
    const json_t *sender = json_array_get(all, 0);
    const json_t *receiver = json_array_get(all, 1);

    assert_int_equal(json_array_size(all), 3);
    assert_string_equal(string(sender, "name"), "engine");
    assert_string_equal(string(sender, "port"), "vcan0");
    assert_string_equal(string(sender, "state"), "error-active");
    assert_int_equal(number(sender, "tec"), 7);
    assert_int_equal(number(sender, "tx_frames"), 1);
    assert_int_equal(number(sender, "tx_bytes"), 4);
    assert_int_equal(number(sender, "tx_bits"), 78);
    assert_int_equal(number(sender, "retransmissions"), 1);
    assert_int_equal(number(json_object_get(sender, "errors"), "bit"), 1);
    assert_int_equal(number(sender, "bus_errors"), 1);
    assert_int_equal(number(json_object_get(sender, "delay"), "count"), 1);
    assert_int_equal(number(json_object_get(sender, "delay"), "mean_ns"), 330000);
    assert_int_equal(number(json_object_get(sender, "delay"), "max_ns"), 330000);
    assert_true(json_is_null(json_object_get(receiver, "port")));
    assert_int_equal(number(receiver, "rx_frames"), 1);
    assert_int_equal(number(receiver, "rx_bytes"), 4);
    assert_int_equal(number(receiver, "rec"), 0);
    assert_int_equal(number(json_object_get(receiver, "errors"), "stuff"), 1);
}

TEST(stats_of_the_rules_are_those_of_the_library)
{
    json_auto_t *root = written_stats(300, BIT_TICKS);
    const json_t *all = json_object_get(root, "rules");

    assert_int_equal(json_array_size(all), 2);
    assert_string_equal(string(json_array_get(all, 0), "name"), "never");
    assert_int_equal(number(json_array_get(all, 0), "matches"), 0);
    assert_int_equal(number(json_array_get(all, 0), "hits"), 0);
    assert_string_equal(string(json_array_get(all, 1), "name"), "crc-flip");
    assert_int_equal(number(json_array_get(all, 1), "hits"), 1);
}

TEST(half_nanoseconds_are_truncated)
{
    json_auto_t *root = written_stats(3, 1);

    assert_int_equal(number(json_object_get(root, "bus"), "time_ns"), 37);
}

TEST(nothing_simulated_is_no_load)
{
    json_auto_t *root = written_stats(0, BIT_TICKS);
    const json_t *node = json_array_get(json_object_get(root, "nodes"), 0);

    assert_int_equal(number(json_object_get(root, "bus"), "load_permille"), 0);
    assert_int_equal(number(json_object_get(node, "delay"), "mean_ns"), 0);
}
