/* SPDX-License-Identifier: MIT
 *
 * test_turns.c - the order in which programs run in virtual time.
 */

#include "cases.h"
#include "engine/turns.h"

/* Adds a program, whose parent is `parent` (0: none that counts). */
static unsigned add(turns *t, unsigned node, const char *words, int pid, int parent)
{
    timing_join join = {.pid = pid, .ancestors = {parent}};
    (void)snprintf(join.program, sizeof join.program, "%s", words);
    return turns_add(t, node, &join);
}

static void wait_until(turns *t, unsigned place, int64_t until_ns)
{
    turns_wait(t, place, until_ns, 0);
}

TEST(turns_are_by_node_then_words_then_coming)
{
    turns t = {.count = 0};
    const unsigned last = add(&t, 1, "a", 10, 0), third = add(&t, 0, "b", 11, 0),
                   first = add(&t, 0, "a", 12, 0), second = add(&t, 0, "a", 13, 0);
    const unsigned order[] = {first, second, third, last};
    for (unsigned i = 0; i < 4; i++) {
        assert_true(turns_all_wait(&t));
        assert_int_equal(turns_begin(&t, 0), order[i]);
        assert_false(turns_all_wait(&t));
        wait_until(&t, order[i], 5);
    }
    assert_int_equal(turns_begin(&t, 4), TURNS_NONE);
    assert_int_equal(turns_next_ns(&t), 5);
}

TEST(who_is_ready_again_at_the_same_moment_comes_behind_the_others)
{
    turns t = {.count = 0};
    const unsigned a = add(&t, 0, "a", 1, 0), b = add(&t, 1, "b", 2, 0);
    for (unsigned i = 0; i < 3; i++) {
        assert_int_equal(turns_begin(&t, 7), a);
        wait_until(&t, a, 7);
        assert_int_equal(turns_begin(&t, 7), b);
        wait_until(&t, b, 7);
    }
    assert_int_equal(turns_begin(&t, 7), a);
    wait_until(&t, a, 8);
    turns_go_on(&t); /* a new moment begins with the first node */
    assert_int_equal(turns_begin(&t, 8), a);
}

TEST(messages_wake_those_who_want_them)
{
    turns t = {.count = 0};
    const unsigned a = add(&t, 0, "a", 1, 0), b = add(&t, 1, "b", 2, 0);
    turns_wait(&t, a, TIMING_NEVER, TIMING_MESSAGES);
    turns_wait(&t, b, TIMING_NEVER, TIMING_ROOM);
    turns_told(&t, 1, TIMING_ROOM);
    turns_told(&t, 2, TIMING_MESSAGES);
    turns_told(&t, 3, TIMING_MESSAGES);
    assert_int_equal(turns_begin(&t, 0), TURNS_NONE);
    turns_told(&t, 2, TIMING_ROOM);
    assert_int_equal(turns_begin(&t, 0), b);
    wait_until(&t, b, TIMING_NEVER);
    turns_told(&t, 0, TIMING_MESSAGES); /* of some process */
    assert_int_equal(turns_begin(&t, 0), a);
}

TEST(children_may_have_the_sockets_of_their_parents)
{
    turns t = {.count = 0};
    const unsigned parent = add(&t, 0, "a", 1, 0), child = add(&t, 0, "a", 2, 1);
    wait_until(&t, parent, TIMING_NEVER);
    turns_wait(&t, child, TIMING_NEVER, TIMING_MESSAGES);
    turns_told(&t, 1, TIMING_MESSAGES);
    assert_int_equal(turns_begin(&t, 0), child);
}

TEST(time_holds_while_a_child_has_not_joined)
{
    turns t = {.count = 0};
    const unsigned parent = add(&t, 0, "sh", 1, 0);
    assert_int_equal(turns_begin(&t, 0), parent);
    turns_wait_for_children(&t, parent);
    assert_false(turns_all_wait(&t));
    const unsigned child = add(&t, 0, "sleep", 2, 1);
    assert_true(turns_all_wait(&t));
    assert_int_equal(turns_begin(&t, 0), child);
    turns_remove(&t, child);
    assert_false(turns_all_wait(&t)); /* the parent does not know yet */
    turns_cancel(&t, parent);
    assert_int_equal(turns_begin(&t, 0), parent);
}

TEST(a_turn_that_has_begun_cannot_be_cancelled)
{
    turns t = {.count = 0};
    const unsigned a = add(&t, 0, "a", 1, 0);
    assert_int_equal(turns_begin(&t, 0), a);
    turns_cancel(&t, a);
    assert_false(turns_all_wait(&t));
    wait_until(&t, a, 9);
    turns_cancel(&t, a);
    assert_int_equal(turns_begin(&t, 0), a);
}

TEST(there_is_room_for_64_programs)
{
    turns t = {.count = 0};
    for (unsigned i = 0; i < TURNS_MAX; i++)
        assert_int_equal(add(&t, 0, "a", (int)i + 1, 0), i);
    assert_int_equal(add(&t, 0, "a", 99, 0), TURNS_NONE);
    turns_remove(&t, 5);
    assert_int_equal(add(&t, 0, "a", 99, 0), 5);
}
