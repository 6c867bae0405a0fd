/* SPDX-License-Identifier: MIT
 *
 * test_broadcast.c - jobs and subscriptions of programs that speak as to socketcand.
 */
#include "rig.h"

#include "port/tunnel/broadcast.h"

#define MS INT64_C(1000000)

static const struct can_frame first = {.can_id = 0x123, .len = 1, .data = {1}};
static const struct can_frame second = {.can_id = 0x123, .len = 2, .data = {2, 7}};

TEST(jobs_are_due_at_each_interval)
{
    broadcast b = {.jobs = NULL};
    struct can_frame frame;
    int64_t late_ns;
    assert_int_equal(broadcast_next_ns(&b), 0);
    assert_true(broadcast_add(&b, &first, 10 * MS, 1000 * MS));
    assert_int_equal(broadcast_next_ns(&b), 1010 * MS);
    assert_false(broadcast_due(&b, &frame, 1010 * MS - 1, &late_ns));
    assert_true(broadcast_due(&b, &frame, 1010 * MS, &late_ns));
    assert_int_equal(late_ns, 0);
    assert_true(broadcast_update(&b, &second)); /* the time stays */
    assert_int_equal(broadcast_next_ns(&b), 1020 * MS);
    assert_true(broadcast_due(&b, &frame, 1055 * MS, &late_ns)); /* three are left out */
    assert_int_equal(late_ns, 35 * MS);
    assert_memory_equal(&frame, &second, sizeof frame);
    assert_int_equal(broadcast_next_ns(&b), 1060 * MS);
    assert_true(broadcast_add(&b, &first, 1, 2000 * MS)); /* instead of that one */
    assert_int_equal(broadcast_next_ns(&b), 2000 * MS + BROADCAST_LEAST_NS);
    assert_true(broadcast_delete(&b, 0x123));
    assert_false(broadcast_delete(&b, 0x123));
    assert_false(broadcast_update(&b, &second));
    assert_int_equal(broadcast_next_ns(&b), 0);
    broadcast_free(&b);
}

TEST(the_job_that_waits_longest_is_first)
{
    broadcast b = {.jobs = NULL};
    int64_t late_ns;
    for (unsigned i = 0; i < BROADCAST_MAX; i++) {
        const struct can_frame frame = {.can_id = i};
        assert_true(broadcast_add(&b, &frame, (int64_t)(BROADCAST_MAX - i) * MS, 0));
    }
    assert_false(broadcast_add(&b, &(struct can_frame){.can_id = BROADCAST_MAX}, MS, 0));
    for (unsigned i = 0; i < 3; i++) {
        struct can_frame frame;
        assert_true(broadcast_due(&b, &frame, 1000 * MS, &late_ns));
        assert_int_equal(frame.can_id, BROADCAST_MAX - 1 - i);
    }
    broadcast_free(&b);
}

TEST(subscriptions_choose_by_content)
{
    broadcast b = {.jobs = NULL};
    const uint8_t mask[CAN_MAX_DLEN] = {0xF0, 0x01};
    assert_true(broadcast_subscribe(&b, 0x123, mask, 0));
    assert_true(broadcast_wants(&b, 0x123));
    assert_false(broadcast_wants(&b, 0x123 | CAN_EFF_FLAG));
    assert_true(broadcast_passes(&b, &first, 0, 0));
    assert_false(broadcast_passes(&b, &first, 0, 0));
    assert_true(broadcast_passes(&b, &second, 0, 0));
    assert_true(broadcast_subscribe(&b, 0x123, NULL, 0));
    assert_true(broadcast_passes(&b, &second, 0, 0));
    assert_true(broadcast_passes(&b, &second, 0, 0));
    assert_true(broadcast_unsubscribe(&b, 0x123));
    assert_false(broadcast_unsubscribe(&b, 0x123));
    assert_false(broadcast_passes(&b, &second, 0, 0));
    broadcast_free(&b);
}

TEST(the_last_frame_of_an_interval_comes_at_its_end)
{
    broadcast b = {.jobs = NULL};
    struct can_frame frame;
    int64_t realtime_ns = 0;
    assert_true(broadcast_subscribe(&b, 0x123, NULL, 100 * MS));
    assert_true(broadcast_passes(&b, &first, 1, 500 * MS));
    assert_int_equal(broadcast_next_ns(&b), 0);
    assert_false(broadcast_passes(&b, &first, 2, 510 * MS));
    assert_false(broadcast_passes(&b, &second, 3, 520 * MS));
    assert_int_equal(broadcast_next_ns(&b), 600 * MS);
    assert_false(broadcast_held(&b, &frame, &realtime_ns, 599 * MS));
    assert_true(broadcast_held(&b, &frame, &realtime_ns, 600 * MS));
    assert_memory_equal(&frame, &second, sizeof frame);
    assert_int_equal(realtime_ns, 3);
    assert_false(broadcast_held(&b, &frame, &realtime_ns, 900 * MS));
    assert_false(broadcast_passes(&b, &first, 4, 699 * MS));
    assert_true(broadcast_held(&b, &frame, &realtime_ns, 700 * MS));
    assert_true(broadcast_passes(&b, &first, 5, 800 * MS));
    broadcast_free(&b);
}
