/* SPDX-License-Identifier: MIT
 *
 * test_loopless.c - frames sent without loopback, by what the kernel counts.
 */

#include "cases.h"
#include "port/kind.h"
#include "port/loopless.h"

/* As Linux 6.1 writes it, with a name that is as long as can be. */
TEST(counters_are_read_by_name)
{
    static char text[] =
        "Inter-|   Receive                                   |  Transmit\n"
        " face |bytes    packets errs drop fifo frame compressed multicast|bytes    packets\n"
        "    lo:   100     2    0    0    0     0          0         0    100     2    0 0\n"
        "vcan0:18446744073709551615 18446744073709551614 0 0 0 0 0 0 7 18446744073709551615 0 0\n"
        "fifteen-letters: 1 3 9 9 9 9 9 9 5 4 9 9 9 9 9 9\n"
        " broken: 1 2 3\n"
        "  vx0:       8       1    0    0    0     0          0         0       16       2    0\n";
    static const netdev_counters wanted[] = {
        {"lo", 2, 2},
        {"vcan0", UINT64_MAX - 1, UINT64_MAX},
        {"fifteen-letters", 3, 4},
        {"vx0", 1, 2},
    };
    netdev_counters n;
    FILE *in = fmemopen(text, strlen(text), "r");
    assert_non_null(in);
    for (unsigned i = 0; i < sizeof wanted / sizeof wanted[0]; i++) {
        assert_true(netdev_next(&n, in));
        assert_string_equal(n.name, wanted[i].name);
        assert_true(n.received == wanted[i].received && n.sent == wanted[i].sent);
    }
    assert_false(netdev_next(&n, in));
    fclose(in);
}

TEST(the_kernel_has_counters)
{
    netdev_counters n;
    bool lo = false;
    FILE *in = netdev_open();
    assert_non_null(in);
    while (netdev_next(&n, in))
        lo = lo || strcmp(n.name, "lo") == 0;
    assert_true(lo);
    fclose(in);
}

static void close_nothing(port *p)
{
    free(p);
}

/* Only certain frames count: none from before, and none that may still be looped back. */
TEST(only_what_is_certain_counts)
{
    static const port_kind kind = {.close = close_nothing};
    static const struct {
        int64_t least;
        int64_t most;
        bool counting;
        uint64_t wanted;
    } looks[] = {
        {90, 100, true, 0},   /* all of these were there before */
        {95, 100, true, 0},
        {100, 100, true, 0},
        {103, 103, false, 0}, /* it is not known yet that it is a vcan */
        {103, 103, true, 3},
        {101, 107, true, 3},  /* busy: there are no fewer than before */
        {-20, 900, true, 3},
        {110, 110, true, 10},
    };
    port_stats stats;
    port *p = port_new(&kind, sizeof *p);
    assert_non_null(p);
    for (unsigned i = 0; i < sizeof looks / sizeof looks[0]; i++) {
        port_count_loopless(p, looks[i].least, looks[i].most, looks[i].counting);
        port_get_stats(p, &stats);
        assert_int_equal(stats.loopless, looks[i].wanted);
    }
    port_close(p);
}
