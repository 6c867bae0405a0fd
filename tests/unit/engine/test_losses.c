/* SPDX-License-Identifier: MIT
 *
 * test_losses.c - what canwired logs about losses: each reason has a text of its own.
 */
#include "cases.h"
#include "serve/losses.h"

/* A reason that is new has to get its text. */
TEST(each_loss_has_a_text_of_its_own)
{
    for (unsigned kind = 0; kind < LOSS_KINDS; kind++) {
        const char *text = losses_text((loss_kind)kind, 2);
        assert_non_null(text);
        for (unsigned other = 0; other < kind; other++)
            assert_string_not_equal(text, losses_text((loss_kind)other, 2));
    }
}

TEST(a_drop_on_the_way_to_the_host_is_told_apart)
{
    for (unsigned why = 0; why < CW_DROP_COUNT; why++) {
        const char *onto = losses_text((loss_kind)why, 2);
        const char *host = losses_text((loss_kind)(LOSS_RECEIVED + why), 2);
        assert_memory_equal(onto, "dropped, ", strlen("dropped, "));
        assert_string_equal(strstr(host, "dropped, "), onto);
    }
}

/* A bus-off loop has 3600 losses an hour. */
TEST(what_goes_on_is_told_ever_more_seldom)
{
    losses_node node = {.kinds = 0};
    const unsigned first[] = {1, 2, 4};
    unsigned lines = 0, longest = 0, since = 0;
    for (unsigned second = 1; second <= 3600; second++) {
        since++;
        if (!losses_due(&node, 1))
            continue;
        if (lines < 3)
            assert_int_equal(second, first[lines]);
        lines++;
        longest = since > longest ? since : longest;
        since = 0;
    }
    assert_int_equal(longest, LOSSES_WAIT_MAX);
    assert_in_range(lines, 60, 70);
    assert_true(losses_due(&node, 3)); /* another kind */
    for (unsigned second = 0; second <= LOSSES_WAIT_MAX; second++)
        assert_false(losses_due(&node, 0));
    assert_true(losses_due(&node, 1)); /* after a minute without */
}

TEST(a_loss_is_news_for_some_time)
{
    static losses all;
    cfg_node node = {.name = (char[]){"a"}};
    const cfg config = {.nodes = &node, .node_count = 1};
    uint64_t now[LOSS_KINDS] = {[CW_DROP_QUEUE_FULL] = 7, [CW_DROP_ONE_SHOT] = 7};
    for (unsigned second = 0; second <= LOSSES_LATELY_S; second++) {
        losses_note(&all.nodes[0], now);
        json_auto_t *status = json_object();
        losses_put_lately(&all, &config, status);
        const json_t *lately = json_object_get(status, "lately");
        assert_int_equal(json_array_size(lately), second < LOSSES_LATELY_S); /* no one-shot */
    }
}
