/* SPDX-License-Identifier: MIT
 *
 * test_unit.c - hints of the service beside errors.
 */
#include "cases.h"
#include "base/unit.h"

#include <errno.h>

/* An error is shown with the hint that follows from it, in any order. */
TEST(test_a_hint_keeps_the_error)
{
    assert_int_equal(setenv("CANWIRE_SERVICE", "bus", 1), 0);
    errno = EACCES;
    assert_non_null(strstr(unit_hint("/etc/canwire/bus.yaml", errno), " (as the user "));
    assert_int_equal(errno, EACCES);
    errno = ENOENT;
    assert_string_equal(unit_hint("/tmp/x", errno), " (the service has a /tmp of its own)");
    assert_int_equal(errno, ENOENT);
    assert_string_equal(unit_hint("/etc/x", errno), "");
}
