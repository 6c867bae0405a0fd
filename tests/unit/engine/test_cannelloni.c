/* SPDX-License-Identifier: MIT
 *
 * test_cannelloni.c - the formats of cannelloni, and the sequence numbers of its packets.
 */
#include "rig.h"

#include "port/tunnel/cannelloni.h"

#define S INT64_C(1000000000)

/* A frame, and its bytes. */
typedef struct frame_case {
    canid_t id;
    uint8_t len;
    bool fd;
    uint8_t flags;
    uint8_t data[4];
    size_t bytes;
    uint8_t in_packet[10];
} frame_case;

static const frame_case frame_cases[] = {
    {0x123, 2, false, 0, {0xAA, 0xBB}, 7, {0, 0, 1, 0x23, 2, 0xAA, 0xBB}},
    {0x123, 0, false, 0, {0}, 5, {0, 0, 1, 0x23, 0}},
    {0x1ABCDEF0 | CAN_EFF_FLAG, 1, false, 0, {7}, 6, {0x9A, 0xBC, 0xDE, 0xF0, 1, 7}},
    {0x123 | CAN_RTR_FLAG, 5, false, 0, {0}, 5, {0x40, 0, 1, 0x23, 5}},
    {0x123, 3, true, CANFD_BRS, {1, 2, 3}, 9, {0, 0, 1, 0x23, 0x83, 1, 1, 2, 3}},
    {0x123, 0, true, CANFD_ESI, {0}, 6, {0, 0, 1, 0x23, 0x80, 2}},
};

TEST(frames_have_their_bytes)
{
    for (size_t i = 0; i < sizeof frame_cases / sizeof frame_cases[0]; i++) {
        const frame_case *c = &frame_cases[i];
        struct canfd_frame frame = {.can_id = c->id, .len = c->len, .flags = c->flags}, back;
        uint8_t bytes[CANNELLONI_FRAME_MAX];
        size_t size;
        memcpy(frame.data, c->data, sizeof c->data);
        assert_int_equal(cannelloni_put_frame(bytes, &frame, c->fd ? CANFD_MTU : CAN_MTU),
                         c->bytes);
        assert_memory_equal(bytes, c->in_packet, c->bytes);
        for (size_t less = 0; less < c->bytes; less++)
            assert_int_equal(cannelloni_take_frame(&back, &size, bytes, less), 0);
        assert_int_equal(cannelloni_take_frame(&back, &size, bytes, c->bytes), c->bytes);
        assert_int_equal(size, c->fd ? CANFD_MTU : CAN_MTU);
        assert_memory_equal(&back, &frame, sizeof back);
    }
}

TEST(the_longest_frame_fits)
{
    struct canfd_frame frame = {.can_id = 0x1FFFFFFF | CAN_EFF_FLAG, .len = CANFD_MAX_DLEN}, back;
    uint8_t bytes[CANNELLONI_FRAME_MAX];
    size_t size;
    assert_int_equal(cannelloni_put_frame(bytes, &frame, CANFD_MTU), CANNELLONI_FRAME_MAX);
    bytes[4] = 0x80 | (CANFD_MAX_DLEN + 1);
    assert_int_equal(cannelloni_take_frame(&back, &size, bytes, sizeof bytes), -1);
    bytes[4] = CAN_MAX_DLEN + 1;
    assert_int_equal(cannelloni_take_frame(&back, &size, bytes, sizeof bytes), -1);
}

TEST(packets_are_checked_as_a_whole)
{
    uint8_t bytes[CANNELLONI_HEAD_BYTES + 12] = {0};
    cannelloni_put_head(bytes, 0xFE, 0x0102);
    assert_memory_equal(bytes, ((uint8_t[]){2, 0, 0xFE, 1, 2}), CANNELLONI_HEAD_BYTES);
    cannelloni_put_head(bytes, 0, 2);
    bytes[9] = 1; /* the first frame has one byte of data, the second one none */
    assert_int_equal(cannelloni_check(bytes, 16), 2);
    assert_int_equal(cannelloni_check(bytes, 17), 2); /* bytes behind do not matter */
    assert_int_equal(cannelloni_check(bytes, 15), -1);
    cannelloni_put_head(bytes, 0, 0);
    assert_int_equal(cannelloni_check(bytes, CANNELLONI_HEAD_BYTES), 0);
    assert_int_equal(cannelloni_check(bytes, CANNELLONI_HEAD_BYTES - 1), -1);
    bytes[0] = 1;
    assert_int_equal(cannelloni_check(bytes, sizeof bytes), -1);
    bytes[0] = 2;
    bytes[1] = 1;
    assert_int_equal(cannelloni_check(bytes, sizeof bytes), -1);
}

/* Follows a packet with a number, whose content is one byte. */
static cannelloni_place follow(cannelloni_sequence *s, uint8_t number, uint8_t content, int64_t ns,
                               unsigned *missing)
{
    const uint8_t bytes[] = {2, 0, number, 0, 0, content};
    return cannelloni_follow(s, bytes, sizeof bytes, ns, missing);
}

TEST(gaps_are_counted)
{
    cannelloni_sequence s = {.begun = false};
    unsigned missing;
    for (unsigned i = 0; i < 1000; i++) {
        assert_int_equal(follow(&s, (uint8_t)(77 + i), 0, 0, &missing), CANNELLONI_NEXT);
        assert_int_equal(missing, 0);
    }
    const uint8_t last = (uint8_t)(77 + 999);
    assert_int_equal(follow(&s, (uint8_t)(last + 2), 0, 0, &missing), CANNELLONI_NEXT);
    assert_int_equal(missing, 1);
    assert_int_equal(follow(&s, (uint8_t)(last + 2 + 128), 0, 0, &missing), CANNELLONI_NEXT);
    assert_int_equal(missing, 127);
}

TEST(late_packets_and_copies_are_told_apart)
{
    cannelloni_sequence s = {.begun = false};
    unsigned missing;
    for (unsigned i = 0; i < 40; i++)
        (void)follow(&s, (uint8_t)(230 + i), 1, 0, &missing); /* up to 13 */
    assert_int_equal(follow(&s, 20, 1, S, &missing), CANNELLONI_NEXT);
    assert_int_equal(missing, 6);
    assert_int_equal(follow(&s, 15, 1, S, &missing), CANNELLONI_LATE);
    assert_int_equal(follow(&s, 15, 1, S, &missing), CANNELLONI_DUPLICATE);
    assert_int_equal(follow(&s, 20, 1, S, &missing), CANNELLONI_DUPLICATE);
    assert_int_equal(follow(&s, 13, 1, S, &missing), CANNELLONI_DUPLICATE);
    assert_int_equal(follow(&s, 19, 1, S, &missing), CANNELLONI_LATE);
    assert_int_equal(missing, 0);
    assert_int_equal(follow(&s, 21, 1, S, &missing), CANNELLONI_NEXT);
    assert_int_equal(missing, 0);
}

TEST(a_peer_begins_again)
{
    unsigned missing;
    static const struct {
        uint8_t number, content;
        int64_t ns;
    } cases[] = {
        {17, 1, 0},      /* too far behind */
        {40, 2, 0},      /* another content */
        {40, 1, 6 * S},  /* too late for a copy */
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        cannelloni_sequence s = {.begun = false};
        for (unsigned k = 0; k < 50; k++)
            (void)follow(&s, (uint8_t)k, 1, 0, &missing);
        assert_int_equal(follow(&s, cases[i].number, cases[i].content, cases[i].ns, &missing),
                         CANNELLONI_RESTART);
        assert_int_equal(follow(&s, (uint8_t)(cases[i].number + 1), 1, 6 * S, &missing),
                         CANNELLONI_NEXT);
        assert_int_equal(missing, 0);
    }
}

/* The bytes are on the heap, so that sanitizers see a read behind them. */
TEST(any_bytes_are_read_within_their_bounds)
{
    uint32_t random = 1;
    for (unsigned round = 0; round < 20000; round++) {
        struct canfd_frame frame;
        size_t size, count = round % 40;
        uint8_t *bytes = malloc(count + 1);
        assert_non_null(bytes);
        for (size_t i = 0; i < count; i++) {
            random = random * 1664525u + 1013904223u;
            bytes[i] = i < 2 ? (uint8_t[]){2, 0}[i] : i == 3 ? 0 : (uint8_t)((random >> 24) & 0x8F);
        }
        FREED uint8_t *exact = realloc(bytes, count ? count : 1);
        assert_non_null(exact);
        const int taken = cannelloni_take_frame(&frame, &size, exact, count);
        assert_true(taken >= -1 && taken <= (int)count);
        const int frames = cannelloni_check(exact, count);
        assert_true(frames >= -1 && (frames < 0 || frames * 5 + 5 <= (int)count));
    }
}
