/* SPDX-License-Identifier: MIT
 *
 * test_output_fd.c - what CAN FD adds to the statistics, as JSON and as text for people.
 */
#include "cases.h"
#include "cli/sim/summary.h"
#include "record/data_timing.h"
#include "record/output.h"
#include "record/rate_load.h"
#include "serve/status.h"

#define BIT_TICKS 160u /* 500 kbit/s */

static char a_name[] = "a";
static char b_name[] = "b";
static char bus_name[] = "mixed";
static cfg_node nodes[] = {{.name = a_name}, {.name = b_name}};
static const cfg config = {
    .bus_name = bus_name,
    .bitrate_bps = 500000,
    .rate = {BIT_TICKS},
    .node_count = 2,
    .nodes = nodes,
};

/* ---- Loads ----------------------------------------------------------------------------------- */

typedef struct load_case {
    const char *name;
    cw_bus_stats before;
    cw_bus_stats after;
    rate_load nominal;
    rate_load data;
} load_case;

static const load_case loads[] = {
    {"nothing", {.ticks = 0}, {.ticks = 0}, {.bits = 0}, {.bits = 0}},
    {"idle", {.ticks = 5}, {.ticks = 1005}, {.bits = 0}, {.bits = 0}},
    {"all nominal",
     {.ticks = 0},
     {.ticks = 1600, .busy_bits = 5, .busy_ticks = 800},
     {.bits = 5, .ticks = 800, .permille = 500},
     {.bits = 0}},
    {"both since the start",
     {.ticks = 0},
     {.ticks = 16000, .busy_bits = 60, .busy_ticks = 9600, .data_bits = 40, .data_ticks = 1600},
     {.bits = 20, .ticks = 8000, .permille = 500},
     {.bits = 40, .ticks = 1600, .permille = 100}},
    {"between two readings",
     {.ticks = 16000, .busy_bits = 60, .busy_ticks = 9600, .data_bits = 40, .data_ticks = 1600},
     {.ticks = 32000, .busy_bits = 75, .busy_ticks = 11200, .data_bits = 50, .data_ticks = 2000},
     {.bits = 5, .ticks = 1200, .permille = 75},
     {.bits = 10, .ticks = 400, .permille = 25}},
    {"a node that is alone at the data rate, while the bus is idle for the others",
     {.ticks = 0},
     {.ticks = 1000, .busy_bits = 2, .busy_ticks = 300, .data_bits = 10, .data_ticks = 400},
     {.bits = 0},
     {.bits = 10, .ticks = 400, .permille = 400}},
};

static void assert_load(rate_load a, rate_load b)
{
    assert_int_equal(a.bits, b.bits);
    assert_int_equal(a.ticks, b.ticks);
    assert_int_equal(a.permille, b.permille);
}

TEST(loads_are_divided_by_rate)
{
    for (size_t i = 0; i < sizeof loads / sizeof loads[0]; i++) {
        const load_case *c = &loads[i];
        assert_load(rate_load_nominal(&c->before, &c->after), c->nominal);
        assert_load(rate_load_data(&c->before, &c->after), c->data);
    }
}

/* ---- A bus ----------------------------------------------------------------------------------- */

typedef struct rig {
    void *memory;
    cw_bus *bus;
} rig;

/* A node at 500 kbit/s and 2 Mbit/s of 80 MHz, sampled at 80 %. */
static cw_node_config fd_node(bool has_rate)
{
    cw_node_config node = {.queue = 4, .warning_limit = 96, .protocol = CW_FD};

    if (!has_rate)
        return node;
    node.timing.bit = (cw_bit_timing){.quantum = CW_TICK,
                                      .prop_seg = 63,
                                      .phase_seg1 = 64,
                                      .phase_seg2 = 32,
                                      .sjw = 32};
    node.timing.data = (cw_data_timing){
        .bit = {.quantum = CW_TICK, .prop_seg = 15, .phase_seg1 = 16, .phase_seg2 = 8, .sjw = 8},
        .brp = 1,
        .data_brp = 1,
        .tdc = {.mode = CW_TDC_AUTO, .tdco = 32}};
    return node;
}

/* Sends a frame of 20 bytes, with BRS where there is a data rate, and a classical one. */
static rig begin(unsigned protocol, bool has_rate)
{
    cw_node_config each[2] = {fd_node(has_rate), fd_node(has_rate)};
    const cw_frame classical = {.id = 0x200, .dlc = 1};
    const cw_frame fd = {.id = 0x100, .flags = CW_FRAME_FD | CW_FRAME_BRS, .dlc = 11};
    rig r;

    each[0].protocol = each[1].protocol = (uint8_t)protocol;
    const cw_bus_config wanted = {
        .bit_ticks = BIT_TICKS, .node_count = 2, .inbox = 4, .events = 256, .nodes = each};
    r.memory = malloc(cw_bus_size(&wanted));
    assert_non_null(r.memory);
    r.bus = cw_bus_init(r.memory, &wanted);
    assert_non_null(r.bus);
    assert_int_equal(cw_node_send(r.bus, 0, &classical, 0), CW_OK);
    if (protocol == CW_FD)
        assert_int_equal(cw_node_send(r.bus, 0, &fd, 0), CW_OK);
    assert_int_equal(cw_bus_advance(r.bus, 1000u * BIT_TICKS), CW_OK);
    for (unsigned i = 0; i < 2; i++) {
        nodes[i].time = (cfg_node_time){.used = has_rate,
                                        .timing = each[i].timing,
                                        .phase[0].bit = {80000000, 1, 63, 64, 32, 32}};
    }
    return r;
}

static json_int_t number(const json_t *object, const char *key)
{
    const json_t *value = json_object_get(object, key);

    assert_true(json_is_integer(value));
    return json_integer_value(value);
}

static json_t *stats_of(const rig *r)
{
    FREED char *text = NULL;
    size_t length = 0;
    FILE *out = open_memstream(&text, &length);

    assert_non_null(out);
    output_stats(out, &config, r->bus);
    assert_int_equal(fclose(out), 0);
    json_t *root = json_loads(text, JSON_REJECT_DUPLICATES, NULL);
    assert_non_null(root);
    return root;
}

TEST(a_classical_bus_tells_nothing_of_it)
{
    rig r = begin(CW_CLASSICAL, false);
    json_t *root = stats_of(&r);
    const json_t *bus = json_object_get(root, "bus");
    const json_t *node = json_array_get(json_object_get(root, "nodes"), 0);
    data_timing t;

    assert_int_equal(number(bus, "frames"), 1);
    assert_null(json_object_get(bus, "fd_frames"));
    assert_null(json_object_get(bus, "data"));
    assert_null(json_object_get(node, "data_errors"));
    assert_false(output_has_fd(&config, r.bus));
    assert_false(data_timing_now(&t, &config, r.bus, 0));
    json_decref(root);
    free(r.memory);
}

/* Before the first frame, too. */
TEST(a_bus_with_a_node_that_knows_can_fd_tells_of_it)
{
    rig r = begin(CW_CLASSICAL, false);
    cfg_node kinds[] = {nodes[0], {.name = b_name, .kind = CFG_KIND_FD}};
    cfg known = config;

    known.nodes = kinds;
    assert_true(output_has_fd(&known, r.bus));
    kinds[1].kind = CFG_KIND_FD_TOLERANT;
    assert_false(output_has_fd(&known, r.bus));
    free(r.memory);
}

TEST(a_bus_without_a_data_rate_tells_its_frames)
{
    rig r = begin(CW_FD, false);
    json_t *root = stats_of(&r);
    const json_t *bus = json_object_get(root, "bus");

    assert_int_equal(number(bus, "frames"), 2);
    assert_int_equal(number(bus, "fd_frames"), 1);
    assert_int_equal(number(json_object_get(bus, "nominal"), "bits"), number(bus, "busy_bits"));
    assert_int_equal(number(json_object_get(bus, "data"), "bits"), 0);
    assert_null(
        json_object_get(json_array_get(json_object_get(root, "nodes"), 0), "data_errors"));
    json_decref(root);
    free(r.memory);
}

TEST(the_statistics_of_both_rates)
{
    static const char *const types[] = {"bit", "stuff", "form", "crc", "ack"};
    rig r = begin(CW_FD, true);
    json_t *root = stats_of(&r);
    const json_t *bus = json_object_get(root, "bus");
    const json_t *nominal = json_object_get(bus, "nominal"), *data = json_object_get(bus, "data");
    const cw_frame fd = {.id = 0x100, .flags = CW_FRAME_FD | CW_FRAME_BRS, .dlc = 11};
    unsigned fast = 1; /* the CRC delimiter begins at the data rate */
    cw_bus_stats stats;
    cw_bits bits;

    assert_int_equal(cw_bits_encode(&bits, &fd), CW_OK);
    for (unsigned n = 0; n < bits.length; n++)
        fast += cw_bits_is_fast(&bits, n);
    cw_bus_get_stats(r.bus, &stats);
    assert_int_equal(number(data, "bits"), fast);
    assert_int_equal(number(bus, "fd_frames"), 1);
    assert_int_equal(number(data, "bits"), stats.data_bits);
    assert_int_equal(number(data, "time_ns"), stats.data_ticks * 25 / 2);
    assert_int_equal(number(nominal, "bits") + number(data, "bits"), number(bus, "busy_bits"));
    assert_int_equal(number(nominal, "time_ns") + number(data, "time_ns"),
                     stats.busy_ticks * 25 / 2);
    for (unsigned i = 0; i < 2; i++) {
        const json_t *node = json_array_get(json_object_get(root, "nodes"), i);
        for (unsigned k = 0; k < 5; k++)
            assert_int_equal(number(json_object_get(node, "data_errors"), types[k]), 0);
    }
    json_decref(root);
    free(r.memory);
}

TEST(the_data_phase_of_a_node)
{
    rig r = begin(CW_FD, true);
    data_timing t;

    assert_true(data_timing_now(&t, &config, r.bus, 1));
    assert_int_equal(timing_bitrate_bps(&t.bit), 2000000);
    assert_int_equal(timing_sample_point_ppb(&t.bit), 800000000);
    assert_int_equal(t.bit.brp, 1);
    assert_int_equal(t.bit.sjw, 8);
    assert_string_equal(data_timing_tdc_name(t.tdc.mode), "auto");
    assert_int_equal(t.tdc.tdco, 32);
    assert_false(data_timing_now(&t, &config, r.bus, 2));
    free(r.memory);
}

/* ---- Text ------------------------------------------------------------------------------------ */

static char *summary_of(const rig *r)
{
    char *text = NULL;
    size_t length = 0;
    FILE *out = open_memstream(&text, &length);

    assert_non_null(out);
    summary_print(out, &config, r->bus);
    assert_int_equal(fclose(out), 0);
    return text;
}

TEST(the_summary_has_a_line_about_it)
{
    rig r = begin(CW_FD, false);
    char *text = summary_of(&r);

    assert_non_null(strstr(text, "\nCAN FD: 1 frame; "));
    assert_non_null(strstr(text, " data bits, load "));
    free(text);
    free(r.memory);
    r = begin(CW_CLASSICAL, false);
    text = summary_of(&r);
    assert_null(strstr(text, "CAN FD"));
    free(text);
    free(r.memory);
}

static const char status[] =
    "{\"bus\":{\"name\":\"mixed\",\"bitrate\":500000,\"time_ns\":2000000000,\"fd_frames\":7,"
    "\"nominal\":{\"bits\":1200,\"load_permille\":125},"
    "\"data\":{\"bits\":3400,\"load_permille\":87}},"
    "\"nodes\":[{\"name\":\"a\",\"state\":\"error-active\",\"tec\":8,\"rec\":1,"
    "\"kind\":\"fd\",\"protocol-exception\":true,\"fd-non-iso\":true,"
    "\"settings\":{\"one-shot\":true,\"restart-ms\":100,\"warning-limit\":96},"
    "\"timing\":{\"bitrate\":500000,\"sample-point\":\"0.800\",\"tq_ps\":12500,\"prop-seg\":63,"
    "\"phase-seg1\":64,\"phase-seg2\":32,\"sjw\":32,\"brp\":1,\"clock\":80000000},"
    "\"data_timing\":{\"dbitrate\":2000000,\"dsample-point\":\"0.750\",\"dtq_ps\":12500,"
    "\"dprop-seg\":14,\"dphase-seg1\":15,\"dphase-seg2\":10,\"dsjw\":5,\"dbrp\":1,"
    "\"tdc-mode\":\"auto\",\"tdcv\":19,\"tdco\":30},"
    "\"data_errors\":{\"bit\":4,\"stuff\":3,\"form\":2,\"crc\":1,\"ack\":0}}]}";

static void assert_shows(const json_t *root, const char *const *lines)
{
    FREED char *text = NULL;
    size_t length = 0;
    FILE *out = open_memstream(&text, &length);

    assert_non_null(out);
    status_print(out, root);
    assert_int_equal(fclose(out), 0);
    const char *at = text;
    for (; *lines; lines++) {
        const char *found = strstr(at, *lines);
        assert_non_null(found);
        at = found + strlen(*lines) - 1; /* the next line may be the very next one */
    }
}

TEST(the_status_has_the_lines_of_ip)
{
    static const char *const lines[] = {
        "\n    fd-frames 7 nominal-bits 1200 load 12.5 % data-bits 3400 load 8.7 %\n",
        "\n    can <ONE-SHOT,FD,FD-NON-ISO,TDC-AUTO> state ERROR-ACTIVE (berr-counter tx 8 rx 1) ",
        "\n\t  clock 80000000\n",
        "\n\t  dbitrate 2000000 dsample-point 0.750\n",
        "\n\t  dtq 12.5 dprop-seg 14 dphase-seg1 15 dphase-seg2 10 dsjw 5 dbrp 1\n",
        "\n\t  tdcv 19 tdco 30\n",
        "\n\t  at the data rate:\n",
        "\n\t  bit-err    stuff-err  form-err   crc-err    ack-err\n",
        "\n\t  4          3          2          1          0\n",
        NULL};
    json_auto_t *root = json_loads(status, 0, NULL);

    assert_non_null(root);
    assert_shows(root, lines);
}

TEST(a_node_without_compensation_has_no_tdcv)
{
    json_auto_t *root = json_loads(status, 0, NULL);
    json_t *node = json_array_get(json_object_get(root, "nodes"), 0);
    FREED char *text = NULL;
    size_t length = 0;
    FILE *out = open_memstream(&text, &length);

    assert_non_null(out);
    json_object_set_new(json_object_get(node, "data_timing"), "tdc-mode", json_string("off"));
    status_print(out, root);
    assert_int_equal(fclose(out), 0);
    assert_non_null(strstr(text, "can <ONE-SHOT,FD,FD-NON-ISO> state"));
    assert_non_null(strstr(text, "dbitrate 2000000"));
    assert_null(strstr(text, "tdcv"));
}
