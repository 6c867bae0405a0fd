/* SPDX-License-Identifier: MIT
 *
 * test_losses.c - what canwired logs about losses: each reason has a text of its own.
 */
#include "serve/losses.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

/* A reason that is new has to get its text. */
static void each_loss_has_a_text_of_its_own(void **state)
{
    (void)state;
    for (unsigned kind = 0; kind < LOSS_KINDS; kind++) {
        const char *text = losses_text((loss_kind)kind);
        assert_non_null(text);
        for (unsigned other = 0; other < kind; other++)
            assert_string_not_equal(text, losses_text((loss_kind)other));
    }
}

static void a_drop_on_the_way_to_the_host_is_told_apart(void **state)
{
    (void)state;
    for (unsigned why = 0; why < CW_DROP_COUNT; why++) {
        const char *onto = losses_text((loss_kind)why);
        const char *host = losses_text((loss_kind)(LOSS_RECEIVED + why));
        assert_memory_equal(onto, "dropped, ", strlen("dropped, "));
        assert_string_equal(strstr(host, "dropped, "), onto);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(each_loss_has_a_text_of_its_own),
        cmocka_unit_test(a_drop_on_the_way_to_the_host_is_told_apart),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
