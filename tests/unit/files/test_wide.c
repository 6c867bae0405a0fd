/* SPDX-License-Identifier: MIT
 *
 * test_wide.c - numbers of 128 bits: products, sums and quotients at the edges and at random.
 */
#include "cases.h"
#include "base/text/wide.h"

#define MAX UINT64_MAX
#define TOP (UINT64_C(1) << 63)
#define RANDOM_ROUNDS 100000

TEST(products_are_exact)
{
    static const struct {
        uint64_t a, b;
        wide product;
    } cases[] = {
        {0, MAX, {0, 0}},
        {1, MAX, {0, MAX}},
        {2, TOP, {1, 0}},
        {MAX, MAX, {MAX - 1, 1}},
        {UINT64_C(1) << 32, UINT64_C(1) << 32, {1, 0}},
        {UINT32_MAX, UINT32_MAX, {0, UINT64_C(0xFFFFFFFE00000001)}},
        {UINT64_C(10000000000000000000), 10, {5, UINT64_C(7766279631452241920)}},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        wide there = wide_product(cases[i].a, cases[i].b);
        wide back = wide_product(cases[i].b, cases[i].a);
        assert_true(there.high == cases[i].product.high && there.low == cases[i].product.low);
        assert_true(back.high == there.high && back.low == there.low);
    }
}

TEST(sums_carry)
{
    wide sum = wide_sum((wide){1, MAX}, (wide){2, 1});
    assert_true(sum.high == 4 && sum.low == 0);
    sum = wide_sum((wide){MAX, MAX}, wide_of(1));
    assert_true(sum.high == 0 && sum.low == 0);
}

TEST(quotients_are_exact)
{
    static const struct {
        wide number;
        uint64_t by;
        wide quotient;
        uint64_t rest;
    } cases[] = {
        {{0, 7}, 2, {0, 3}, 1},
        {{1, 0}, 1, {1, 0}, 0},
        {{1, 0}, 2, {0, TOP}, 0},
        {{1, 0}, 3, {0, UINT64_C(0x5555555555555555)}, 1},
        {{MAX, MAX}, MAX, {1, 1}, 0},
        {{MAX - 1, MAX}, MAX, {0, MAX}, MAX - 1},
        {{5, UINT64_C(7766279631452241920)}, 10, {0, UINT64_C(10000000000000000000)}, 0},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        uint64_t rest;
        wide quotient = wide_divide(&rest, cases[i].number, cases[i].by);
        assert_true(quotient.high == cases[i].quotient.high);
        assert_true(quotient.low == cases[i].quotient.low);
        assert_true(rest == cases[i].rest);
    }
}

/* Numbers of all lengths. */
static uint64_t draw(uint64_t *seed)
{
    *seed = *seed * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
    return (*seed ^ *seed >> 29) >> (*seed >> 58);
}

TEST(a_quotient_times_its_divisor_is_the_number)
{
    uint64_t seed = 1;
    for (int i = 0; i < RANDOM_ROUNDS; i++) {
        wide number = {draw(&seed), draw(&seed)};
        uint64_t by = draw(&seed) | 1;
        uint64_t rest;
        wide quotient = wide_divide(&rest, number, by);
        wide back = wide_sum(wide_product(quotient.low, by), wide_of(rest));
        back.high += quotient.high * by;
        assert_true(rest < by);
        assert_true(back.high == number.high && back.low == number.low);
    }
}
