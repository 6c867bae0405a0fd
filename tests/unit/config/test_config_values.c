/* SPDX-License-Identifier: MIT
 *
 * test_config_values.c - values in configuration files: times and bit rates as the clock of the bus
 * has them.
 */
#include "cases.h"
#include "configs.h"

#include <inttypes.h>

/* The head of the file has a line "# warns: LINE:COLUMN: message" for each. */
static void assert_warns(const char *path)
{
    char wanted[LINE_SIZE];
    CFG *config = load_good(path);
    FILE *file = fopen(path, "r");
    const char *rest = config->warnings;
    assert_non_null(file);
    while (fgets(wanted, sizeof wanted, file) && strncmp(wanted, "# warns: ", 9) == 0) {
        char line[LINE_SIZE];
        unsigned at;
        unsigned column;
        int place = 0;
        assert_int_equal(sscanf(wanted + 9, "%u:%u: %n", &at, &column, &place), 2);
        int length =
            snprintf(line, sizeof line, "%s:%u:%u: warning: %s", path, at, column,
                     wanted + 9 + place);
        if (strncmp(rest, line, (size_t)length) != 0)
            fail_msg("wanted %sgot %s", line, rest);
        rest += length;
    }
    assert_string_equal(rest, "");
    assert_true(rest > config->warnings);
    fclose(file);
}

TEST(times_that_are_rounded_are_told)
{
    assert_warns(GOOD "rounded.yaml");
    CFG *config = load_good(GOOD "full.yaml");
    assert_string_equal(config->warnings, "");
}

TEST(nodes_without_margin_are_told)
{
    assert_warns(GOOD "margins.yaml");
}

TEST(masters_that_collide_are_told)
{
    assert_warns(GOOD "masters.yaml");
}

/* Exactly the rates within 0.1 % of 80 MHz / n are taken. */
TEST(bit_rates_are_near_what_the_clock_makes)
{
    static const struct {
        unsigned bitrate;
        unsigned ticks; /* 0: refused */
    } cases[] = {
        {5000, 16000}, {10000, 8000}, {33333, 2400}, {83333, 960}, {95238, 840},
        {250000, 320}, {615384, 130}, {615385, 130}, {799200, 0},  {800000, 100},
        {800799, 100}, {800801, 0},   {987654, 81},  {990000, 0},  {999000, 0},
        {999001, 80},  {1000000, 80}, {4999, 0},     {1000001, 0},
    };
    for (size_t i = 0; i < COUNT(cases); i++) {
        char content[80];
        int length = snprintf(content, sizeof content, "bus: {bitrate: %u}\nnodes: [{name: a}]\n",
                              cases[i].bitrate);
        char *path = make_file(content, (size_t)length);
        FILE *nowhere = fopen("/dev/null", "w");
        cfg *config = cfg_load(path, nowhere);

        uint64_t ticks = config ? cw_rate_ticks(config->rate, 1) : 0;
        if (ticks != cases[i].ticks)
            fail_msg("%u: %" PRIu64 " ticks", cases[i].bitrate, ticks);
        cfg_free(config);
        fclose(nowhere);
        drop_file(path);
    }
}
