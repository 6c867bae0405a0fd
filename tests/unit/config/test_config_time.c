/* SPDX-License-Identifier: MIT
 *
 * test_config_time.c - clocks, bit timings and places of nodes in configuration files.
 */
#include "cases.h"
#include "configs.h"

#include "config/change/retime.h"
#include "run/bus_make.h"

/* Loads a configuration from a text. */
static cfg *load_text(const char *text)
{
    const cfg_file file = {.name = "bus.yaml", .text = text, .size = strlen(text)};
    cfg *config = cfg_load_given(&file, 1, stderr);

    assert_non_null(config);
    return config;
}

/* ---- The bit timing of a running node -------------------------------------------------------- */

TEST(prescaler_and_error_are_found_from_a_quantum)
{
    static const struct {
        uint32_t brp; /* of the node now; the configuration has 2 */
        int32_t ppm;
        uint32_t found_brp;
        int64_t found_ppm;
    } cases[] = {
        {2, 0, 2, 0},           {2, 1, 2, 1},       {2, -300, 2, -300}, {2, 100000, 2, 100000},
        {2, -100000, 2, -100000}, {4, 0, 4, 0},     {4, 50, 4, 50},     {1, 0, 1, 0},
        {3, -20, 3, -20},
    };
    CFG *config = load_text("bus: { bitrate: 500000 }\n"
                            "nodes: [ { name: a, clock: 16MHz, brp: 2, prop-seg: 4, "
                            "phase-seg1: 5, phase-seg2: 6 } ]");

    for (size_t i = 0; i < COUNT(cases); i++) {
        cw_bit_timing now = config->nodes[0].time.timing.bit;
        bit_timing found;
        int64_t ppm;
        now.quantum = cw_quantum(16000000, cases[i].brp, cases[i].ppm);
        now.phase_seg1 = 7;
        cfg_timing_now(&found, &ppm, config, 0, &now);
        assert_int_equal(found.brp, cases[i].found_brp);
        assert_int_equal(ppm, cases[i].found_ppm);
        assert_int_equal(found.phase_seg1, 7);
        assert_int_equal(found.clock_hz, 16000000);
    }
}

/* ---- Defaults -------------------------------------------------------------------------------- */

static void assert_segments(const cfg_node *node, bit_timing expected)
{
    const bit_timing *bit = &node->time.phase[0].bit;

    assert_int_equal(bit->clock_hz, expected.clock_hz);
    assert_int_equal(bit->brp, expected.brp);
    assert_int_equal(bit->prop_seg, expected.prop_seg);
    assert_int_equal(bit->phase_seg1, expected.phase_seg1);
    assert_int_equal(bit->phase_seg2, expected.phase_seg2);
    assert_int_equal(bit->sjw, expected.sjw);
}

TEST(keys_of_time_have_defaults_and_nodes_may_say_otherwise)
{
    CFG *config = load_good(GOOD "time-defaults.yaml");
    const cfg_node *nodes = config->nodes;

    assert_segments(&nodes[0], (bit_timing){16000000, 2, 4, 5, 6, 4});
    assert_segments(&nodes[1], (bit_timing){16000000, 4, 2, 2, 3, 2});
    assert_segments(&nodes[2], (bit_timing){16000000, 2, 5, 6, 4, 1}); /* as Linux finds them */
    assert_segments(&nodes[3], (bit_timing){32000000, 4, 4, 5, 6, 4});
    assert_int_equal(nodes[0].time.ppm, 100);
    assert_int_equal(nodes[3].time.ppm, 0);
    assert_true(nodes[0].time.timing.bit.triple_sampling);
    assert_false(nodes[2].time.timing.bit.triple_sampling);
    assert_int_equal(nodes[0].time.timing.tx_delay[CW_DOMINANT], CW_TICK * 2);
    assert_int_equal(nodes[2].time.timing.tx_delay[CW_DOMINANT], 0);
    assert_int_equal(nodes[2].time.timing.rx_delay[CW_RECESSIVE], CW_TICK * 4);
    assert_int_equal(nodes[0].time.timing.stub, CW_TICK);
    assert_int_equal(nodes[2].time.timing.stub, 0);
    assert_string_equal(config->warnings, "");
}

/* ---- Termination ----------------------------------------------------------------------------- */

/* The longest way is 30 m with two stubs of 2.5 m, 14 ticks of 12.5 ns. */
TEST(missing_terminators_ring_for_round_trips)
{
    static const struct {
        const char *termination;
        int trips;
    } cases[] = {{"both", 0}, {"one", 1}, {"none", 3}};

    for (size_t i = 0; i < COUNT(cases); i++) {
        char text[400];
        snprintf(text, sizeof text,
                 "bus: { bitrate: 500000, termination: %s }\n"
                 "defaults: { stub: 2.5m }\n"
                 "nodes: [ { name: a, position: 40m }, { name: b, position: 20m, stub: 0 },\n"
                 "         { name: c, position: 10m }, { name: d, position: 12m, ringing: 25ns } ]",
                 cases[i].termination);
        CFG *config = load_text(text);
        for (size_t n = 0; n < 3; n++)
            assert_int_equal(config->nodes[n].time.timing.ringing,
                             CW_TICK * 28 * cases[i].trips);
        assert_int_equal(config->nodes[3].time.timing.ringing, CW_TICK * 2);
        assert_string_equal(config->warnings, "");
    }
}

TEST(termination_adds_to_the_ringing_of_defaults)
{
    CFG *config = load_good(GOOD "time-defaults.yaml");

    assert_int_equal(config->nodes[0].time.timing.ringing, CW_TICK * (8 + 28));
    assert_int_equal(config->nodes[4].time.timing.ringing, 0);
}

TEST(a_line_without_length_does_not_ring)
{
    CFG *config = load_text("bus: { bitrate: 500000, termination: none }\n"
                            "nodes: [ { name: a }, { name: b, position: 0 } ]");

    assert_int_equal(config->nodes[0].time.timing.ringing, 0);
    assert_non_null(strstr(config->warnings, "bus.yaml:2:8: warning: termination: nothing rings"));
}

/* ---- The data phase -------------------------------------------------------------------------- */

/* Without keys of their own all nodes have one data phase, and stay on the common grid of bits. */
TEST(default_data_phases_are_on_the_grid)
{
    static const uint32_t rates[][2] = {{125000, 500000},   {250000, 1000000}, {500000, 1000000},
                                        {500000, 2000000},  {500000, 4000000}, {500000, 5000000},
                                        {1000000, 5000000}, {1000000, 8000000}};
    static const char *const controllers[] = {"any", "m_can", "mcp251xfd", "flexcan_fd"};

    for (size_t i = 0; i < COUNT(rates) * COUNT(controllers); i++) {
        const uint32_t *rate = rates[i / COUNT(controllers)];
        char text[300];
        FREED void *memory;
        snprintf(text, sizeof text, "{ bus: { bitrate: %u, dbitrate: %u }, defaults: { controller: "
                 "%s }, nodes: [ { name: a }, { name: b }, { name: c, kind: classical } ] }",
                 (unsigned)rate[0], (unsigned)rate[1], controllers[i % COUNT(controllers)]);
        CFG *config = load_text(text);
        assert_int_equal(timing_bitrate_bps(&config->nodes[0].time.phase[1].bit), rate[1]);
        cw_bus *bus = bus_make(&memory, config);
        assert_non_null(bus);
        if (!cw_bus_is_on_grid(bus))
            fail_msg("%s", text);
    }
}

/* Changes keys of node 1. */
static void set(cw_bus *bus, cfg *config, retime_key key, const char *text)
{
    cfg_retime change = {.given = 0};
    cw_settings settings = {.which = 0};
    char problem[RETIME_PROBLEM_MAX] = "";
    cfg_node_time time = {.used = false};

    if (!cfg_retime_put(&change, problem, cfg_retime_row(key), text) ||
        !cfg_retime_node(&time, &settings, problem, config, 1, &change))
        fail_msg("%s", problem);
    assert_int_equal(cw_node_set(bus, 1, &settings), CW_OK);
    config->nodes[1].time = time;
}

TEST(another_data_phase_leaves_the_grid_and_the_same_one_comes_back)
{
    static const struct {
        retime_key key;
        const char *away;
        const char *back;
    } cases[] = {
        {RETIME_DBRP, "2", "1"},
        {RETIME_DSJW, "4", "5"},
        {RETIME_DPHASE_SEG2, "9", "10"},
        {RETIME_DSAMPLE_POINT, "70%", "75%"},
        {RETIME_SAMPLE_POINT, "80%", "87.5%"},
        {RETIME_CLOCK, "40MHz", "80MHz"},
    };
    CFG *config = load_text("{ bus: { bitrate: 500000, dbitrate: 2000000 }, nodes: [ { name: a }, "
                            "{ name: b } ] }");
    FREED void *memory;
    cw_bus *bus = bus_make(&memory, config);

    for (size_t i = 0; i < COUNT(cases); i++) {
        set(bus, config, cases[i].key, cases[i].away);
        if (cw_bus_is_on_grid(bus))
            fail_msg("%s=%s", cfg_retime_row(cases[i].key)->name, cases[i].away);
        set(bus, config, cases[i].key, cases[i].back);
        if (!cw_bus_is_on_grid(bus))
            fail_msg("%s=%s", cfg_retime_row(cases[i].key)->name, cases[i].back);
    }
}

/* Present values of a node are printed in a form that sets the same. */
TEST(present_values_can_be_set_again)
{
    CFG *config = load_text("{ bus: { bitrate: 500000, dbitrate: 2000000 }, nodes: [ { name: a }, "
                            "{ name: b, dbrp: 2, dprop-seg: 6, dphase-seg1: 7, dphase-seg2: 6, "
                            "tdc-mode: manual, tdcv: 9, tdco: 40 } ] }");
    const cfg_retime present = cfg_retime_present(&config->nodes[1].time);
    cfg_retime again = {.given = 0};
    char problem[RETIME_PROBLEM_MAX];
    cw_settings settings = {.which = 0};
    cfg_node_time time;
    unsigned of_data = 0;

    for (retime_key key = 0; key < RETIME_KEYS; key++) {
        char text[TIME_TEXT_MAX];
        if (!(present.given >> key & 1u))
            continue;
        of_data += key >= RETIME_DBRP && key <= RETIME_TDCV;
        cfg_retime_print(text, &present, cfg_retime_row(key));
        assert_true(cfg_retime_put(&again, problem, cfg_retime_row(key), text));
    }
    assert_int_equal(of_data, 8); /* all but the sample point */
    assert_int_equal(again.given, present.given);
    assert_true(cfg_retime_node(&time, &settings, problem, config, 1, &again));
    assert_int_equal(settings.data.data_brp, 2);
    assert_int_equal(settings.data.bit.prop_seg, 6);
    assert_int_equal(settings.data.bit.phase_seg2, 6);
    assert_memory_equal(&time.phase[1].bit, &config->nodes[1].time.phase[1].bit,
                        sizeof time.phase[1].bit);
    assert_int_equal(settings.data.tdc.tdcv, 9);
    assert_int_equal(settings.data.tdc.tdco, 40);
}
