/* SPDX-License-Identifier: MIT
 *
 * test_counted.c - numbers with their nouns.
 */
#include "cases.h"
#include "base/text/counted.h"

TEST(nouns_have_the_number_of_their_count)
{
    static const struct {
        uint64_t count;
        const char *noun;
        const char *expected;
    } cases[] = {
        {0, "frame", "0 frames"},         {1, "error frame", "1 error frame"},
        {2, "bus", "2 buses"},            {1, "bus", "1 bus"},
        {3, "process", "3 processes"},    {2, "entry", "2 entries"},
        {1, "entry", "1 entry"},          {2, "gateway", "2 gateways"},
        {UINT64_MAX, "row", "18446744073709551615 rows"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++)
        assert_string_equal(counted(cases[i].count, cases[i].noun).text, cases[i].expected);
}
