/* SPDX-License-Identifier: MIT
 *
 * test_prng.c - random streams: the published generator, by seed and name.
 */
#include "cases.h"
#include "canwire.h"
#include "rule/prng.h"

/* The same draws on every machine and in every release: splitmix64, by its published values. */
TEST(the_generator_is_splitmix64)
{
    cw_prng prng = {.state = 0};
    assert_true(cw_prng_next(&prng) == UINT64_C(0xE220A8397B1DCDAF));
    assert_true(cw_prng_next(&prng) == UINT64_C(0x6E789E6AA1B965F4));
    assert_true(cw_prng_next(&prng) == UINT64_C(0x06C45D188009454F));
}

static uint64_t first_draw(uint64_t seed, const char *name)
{
    cw_prng prng;
    cw_prng_init(&prng, seed, name);
    return cw_prng_next(&prng);
}

/* Every byte of the name counts, up to the documented number. */
TEST(a_stream_is_that_of_seed_and_name)
{
    char long_name[CW_RULE_NAME_MAX + 2];
    memset(long_name, 'x', sizeof long_name);
    long_name[CW_RULE_NAME_MAX + 1] = '\0';
    uint64_t draw = first_draw(1, long_name);
    long_name[CW_RULE_NAME_MAX] = 'y';
    assert_true(draw == first_draw(1, long_name));
    long_name[CW_RULE_NAME_MAX - 1] = 'y';
    assert_true(draw != first_draw(1, long_name));
    assert_true(first_draw(1, "ab") != first_draw(1, "ba"));
    assert_true(first_draw(1, "ab") != first_draw(2, "ab"));
    assert_true(first_draw(0, "") != first_draw(0, "a"));
}

/* Any number of a stream at once, the same as one after the other. */
TEST(random_numbers_are_those_of_the_stream)
{
    cw_prng prng;
    cw_prng_init(&prng, 42, "engine");
    for (uint64_t n = 0; n < 100; n++) {
        uint64_t number = cw_prng_next(&prng);
        assert_true(cw_random(42, "engine", n) == number);
        assert_true(cw_random(43, "engine", n) != number);
        assert_true(cw_random(42, "gearbox", n) != number);
    }
}

TEST(skipped_draws_are_those_that_would_have_come)
{
    cw_prng drawn, skipped;
    cw_prng_init(&drawn, 42, "engine");
    cw_prng_init(&skipped, 42, "engine");
    for (unsigned i = 0; i < 1000; i++)
        (void)cw_prng_next(&drawn);
    cw_prng_skip(&skipped, 999);
    cw_prng_skip(&skipped, 1);
    assert_true(cw_prng_next(&skipped) == cw_prng_next(&drawn));
}
