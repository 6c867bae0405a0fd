/* SPDX-License-Identifier: MIT
 *
 * test_response.c - worst-case response times, against examples of the literature and by hand.
 */

#include "cases.h"
#include "cli/analyse/failure.h"

#define MS ((uint64_t)CW_CLOCK_HZ / 1000)
#define US (MS / 1000)
#define BIT_125K (8 * US)

/* The counter-example of Davis et al. 2007: 125 kbit/s, frames of 125 bits with 7 bytes. The
 * analysis before it found 3 ms for C, by its first instance alone. */
TEST(the_second_instance_may_be_the_worst)
{
    response_message m[] = {
        {.key = 1, .period = 5 * MS / 2, .length = 125 * BIT_125K, .node = 0},
        {.key = 2, .period = 7 * MS / 2, .length = 125 * BIT_125K, .node = 1},
        {.key = 3, .period = 7 * MS / 2, .length = 125 * BIT_125K, .node = 2},
    };
    response_bus bus = {.bit = BIT_125K, .error_every = CW_NEVER, .messages = m, .count = 3};
    response_find(&bus);
    assert_int_equal(m[0].response, 2 * MS);
    assert_int_equal(m[1].response, 3 * MS);
    assert_int_equal(m[2].response, 7 * MS / 2);
    assert_int_equal(m[2].instances, 2);
    assert_int_equal(m[0].blocking, MS);
    assert_int_equal(m[2].blocking, 0);
}

/* A frame that comes in the first bit of another one still wins. */
TEST(a_frame_that_just_comes_in_time_wins)
{
    response_message m[] = {
        {.key = 1, .period = 10 * MS, .length = 1 * MS, .node = 0},
        {.key = 2, .period = 50 * MS, .length = 1 * MS, .node = 1},
        {.key = 9, .period = 50 * MS, .length = 9 * MS - 4 * US, .node = 2},
    };
    response_bus bus = {.bit = BIT_125K, .error_every = CW_NEVER, .messages = m, .count = 3};
    response_find(&bus);
    /* 9 ms - 4 us of blocking, the first, and the second of message 1 at 10 ms: 4 us too late, but
     * within a bit */
    assert_int_equal(m[1].response, 9 * MS - 4 * US + 3 * MS);
    m[2].length = 9 * MS - 8 * US; /* at the end of that bit */
    response_find(&bus);
    assert_int_equal(m[1].response, 9 * MS - 8 * US + 3 * MS);
    m[2].length = 9 * MS - 8 * US - 1;
    response_find(&bus);
    assert_int_equal(m[1].response, 9 * MS - 8 * US - 1 + 2 * MS);
}

TEST(jitter_counts_for_the_frame_and_for_those_below)
{
    response_message m[] = {
        {.key = 1, .period = 10 * MS, .length = 1 * MS, .jitter = 9 * MS, .node = 0},
        {.key = 2, .period = 100 * MS, .length = 1 * MS, .node = 1},
    };
    response_bus bus = {.bit = BIT_125K, .error_every = CW_NEVER, .messages = m, .count = 2};
    response_find(&bus);
    assert_int_equal(m[0].response, 9 * MS + 2 * MS);
    assert_int_equal(m[1].response, 3 * MS); /* two of message 1 come one after the other */
}

/* Each error takes 31 bits and the longest frame so far. */
TEST(errors_take_time)
{
    response_message m[] = {
        {.key = 1, .period = 100 * MS, .length = 2 * MS, .node = 0},
        {.key = 2, .period = 100 * MS, .length = 1 * MS, .node = 1},
    };
    response_bus bus = {.bit = BIT_125K, .error_every = 50 * MS, .messages = m, .count = 2};
    response_find(&bus);
    const uint64_t error = 31 * BIT_125K + 2 * MS;
    assert_int_equal(m[0].response, 1 * MS + error + 2 * MS);
    assert_int_equal(m[1].response, error + 3 * MS);
    bus.error_every = 1 * MS; /* more than there is time for */
    response_find(&bus);
    assert_int_equal(m[0].response, CW_NEVER);
}

TEST(more_than_the_bus_can_carry_has_no_bound)
{
    response_message m[] = {
        {.key = 1, .period = 2 * MS, .length = 1 * MS, .node = 0},
        {.key = 2, .period = 2 * MS, .length = 1 * MS + 1, .node = 1},
        {.key = 3, .period = CW_NEVER, .length = 1 * MS, .node = 1},
    };
    response_bus bus = {.bit = BIT_125K, .error_every = CW_NEVER, .messages = m, .count = 3};
    response_find(&bus);
    assert_int_equal(m[0].response, 2 * MS + 1);
    assert_int_equal(m[1].response, CW_NEVER);
    assert_int_equal(m[2].response, CW_NEVER);
}

/* An urgent frame waits in its queue behind one of no urgency, and then disturbs others late. */
TEST(a_fifo_node_makes_its_frames_wait_for_each_other)
{
    response_message m[] = {
        {.key = 1, .period = 20 * MS, .length = 1 * MS, .node = 0, .fifo = true},
        {.key = 2, .period = 20 * MS, .length = 1 * MS, .node = 1},
        {.key = 3, .period = 20 * MS, .length = 1 * MS, .node = 2},
        {.key = 4, .period = 20 * MS, .length = 1 * MS, .node = 0, .fifo = true},
    };
    response_bus bus = {.bit = BIT_125K, .error_every = CW_NEVER, .messages = m, .count = 4};
    response_find(&bus);
    assert_int_equal(m[0].response, 4 * MS); /* as the last one of its node */
    assert_int_equal(m[3].response, 4 * MS);
    assert_int_equal(m[1].response, 3 * MS);
    assert_int_equal(m[2].response, 4 * MS);
    m[0].fifo = m[3].fifo = false;
    response_find(&bus);
    assert_int_equal(m[0].response, 2 * MS);
    m[0].fifo = m[3].fifo = true;
    m[2].period = 2 * MS; /* the fifo node need not come to its last frame any more */
    m[1].period = 2 * MS;
    response_find(&bus);
    assert_int_equal(m[0].response, CW_NEVER);
    assert_int_equal(m[1].response, CW_NEVER);
}

/* A late message has two frames at once. The second one is in the mailbox of another message. */
TEST(a_late_message_takes_mailboxes_of_others)
{
    response_message m[] = {
        {.key = 1, .period = 20 * MS, .length = 1 * MS, .node = 0, .boxed = true},
        {.key = 2, .period = 20 * MS, .length = 1 * MS, .node = 1},
        {.key = 3, .period = 20 * MS, .length = 1 * MS, .node = 0, .boxed = true},
    };
    response_bus bus = {.bit = BIT_125K, .error_every = CW_NEVER, .messages = m, .count = 3};
    response_find(&bus);
    assert_false(m[0].fifo || m[2].fifo);
    assert_int_equal(m[0].response, 2 * MS);
    m[2].period = 5 * MS / 2; /* its response is 3 ms */
    response_find(&bus);
    assert_true(m[0].fifo && m[2].fifo && !m[1].fifo);
    assert_true(m[0].response > 2 * MS);
    m[2].period = 20 * MS;
    response_find(&bus);
    assert_false(m[0].fifo || m[2].fifo);
    assert_int_equal(m[0].response, 2 * MS);
}

/* Errors that come at any time: each takes 31 bits and the longest frame so far. */
TEST(messages_survive_errors_up_to_their_period)
{
    response_message m[] = {
        {.key = 1, .period = 100 * MS, .length = 2 * MS, .node = 0},
        {.key = 2, .period = 100 * MS, .length = 1 * MS, .node = 1},
        {.key = 3, .period = 4 * MS, .length = 1 * MS, .node = 2},
    };
    const response_bus bus = {.bit = BIT_125K, .error_every = 50 * MS, .messages = m, .count = 3};
    int survived[3];
    failure_find(&bus, survived);
    assert_int_equal(survived[0], 43); /* (100 - 1 - 2) / 2.248 */
    assert_int_equal(survived[1], 42); /* (100 - 1 - 3) / 2.248 */
    assert_int_equal(survived[2], 0);
    m[2].period = 3 * MS;
    failure_find(&bus, survived);
    assert_int_equal(survived[2], -1);
}

static void assert_near(double value, double expected)
{
    assert_true(value > expected * (1 - 1e-9) && value < expected * (1 + 1e-9));
}

/* The distribution of Poisson, by hand. */
TEST(probabilities_of_errors)
{
    assert_near(failure_probability(-1, 0.5), 1);
    assert_near(failure_probability(0, 1), 0.63212055882855768);
    assert_near(failure_probability(1, 2), 0.59399415029016192);
    assert_near(failure_probability(2, 1e-3), 1.6654171660556e-10);
    assert_near(failure_probability(64, 1000), 1);
    assert_true(failure_probability(3, 0) <= 0);
    assert_near(failure_of_frame(1, 0.25), 0.25);
    assert_near(failure_of_frame(2, 0.25), 0.4375);
    assert_near(failure_of_frame(100, 1e-12), 1e-10 * (1 - 49.5e-12));
}

TEST(priorities_are_those_of_arbitration)
{
    const cw_frame order[] = {
        {.id = 0x100},
        {.id = 0x100, .flags = CW_FRAME_REMOTE},
        {.id = 0x100 << 18, .flags = CW_FRAME_EXTENDED},
        {.id = 0x100 << 18, .flags = CW_FRAME_EXTENDED | CW_FRAME_REMOTE},
        {.id = 0x100 << 18 | 1, .flags = CW_FRAME_EXTENDED},
        {.id = 0x101},
    };
    for (size_t i = 0; i + 1 < sizeof order / sizeof order[0]; i++)
        assert_true(response_key(&order[i]) < response_key(&order[i + 1]));
}
