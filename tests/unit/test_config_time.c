/* SPDX-License-Identifier: MIT
 *
 * test_config_time.c - clocks, bit timings and places of nodes in configuration files.
 */
#include "configs.h"

#include <string.h>

/* Loads a configuration from a text. */
static cfg *load_text(const char *text)
{
    const cfg_file file = {.name = "bus.yaml", .text = text, .size = strlen(text)};
    cfg *config = cfg_load_given(&file, 1, stderr);

    assert_non_null(config);
    return config;
}

/* ---- The bit timing of a running node -------------------------------------------------------- */

static void prescaler_and_error_are_found_from_a_quantum(void **state)
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
    cfg *config = load_text("bus: { bitrate: 500000 }\n"
                            "nodes: [ { name: a, clock: 16MHz, brp: 2, prop-seg: 4, "
                            "phase-seg1: 5, phase-seg2: 6 } ]");

    (void)state;
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
    cfg_free(config);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(prescaler_and_error_are_found_from_a_quantum),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
