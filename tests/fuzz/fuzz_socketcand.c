/* SPDX-License-Identifier: MIT
 *
 * fuzz_socketcand.c - bytes of any kind from a program that speaks as to socketcand.
 *
 * They come in pieces. Whatever they are, all answers are messages in brackets, frames are as
 * linux/can.h allows them, and the program is read to its end.
 *
 * Input: the length of each piece, and the piece.
 */
#include "fuzz.h"

#include "port/shared.h"
#include "port/tunnel/socketcand.h"

#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#define ANSWERS_BYTES 65536u
#define PIECE_MAX 600u
#define READS_MAX 2000u
#define FRAMES_MAX 500u /* of one piece, with those of jobs, which never end */

static unsigned read_nothing(port *p, port_frame *frames, unsigned max, bool *more)
{
    (void)p;
    (void)frames;
    (void)max;
    *more = false;
    return 0;
}

static const port_kind kind = {.close = shared_close, .read = read_nothing, .send = shared_send};
static const shared_ways ways = {.member = &member_socketcand};

/* Answers are texts in brackets with spaces between them. */
static void check_answers(int fd)
{
    static char answers[ANSWERS_BYTES];
    ssize_t size;
    while ((size = recv(fd, answers, sizeof answers, MSG_DONTWAIT)) > 0)
        for (ssize_t i = 0; i < size; i++)
            REQUIRE(answers[i] >= ' ' && answers[i] <= '~');
}

static void check_frame(const port_frame *frame)
{
    REQUIRE(frame->frame.id <= CAN_EFF_MASK);
    REQUIRE((frame->frame.flags & CW_FRAME_EXTENDED) || frame->frame.id <= CAN_SFF_MASK);
    REQUIRE(cw_frame_length(&frame->frame) <= CANFD_MAX_DLEN);
}

/* Reads until there is nothing to read. Returns false when the program has been sent away. */
static bool read_all(port *p, member *c, int fd, bool fd_node)
{
    port_frame frame;
    unsigned frames = 0;
    for (unsigned reads = 0; reads < READS_MAX && frames < FRAMES_MAX; reads++) {
        const member_result result = member_read(c, p, &frame);
        check_answers(fd);
        frames += result == MEMBER_FRAME;
        if (result == MEMBER_FRAME)
            check_frame(&frame);
        else if (result == MEMBER_GREETS)
            member_welcome(c, "engine", fd_node);
        else if (result != MEMBER_CONTROL)
            return result == MEMBER_NOTHING;
    }
    REQUIRE(frames == FRAMES_MAX);
    return true;
}

/* Frames of the bus and error frames come in between. */
static void send_some(member *c, fuzz_input *in)
{
    const cw_frame sent = fuzz_frame(in);
    const message_head head = {.type = MESSAGE_FRAME};
    struct canfd_frame frame;
    const size_t size = port_make_frame(&frame, &sent);
    if (member_takes(c, &frame, size))
        (void)member_send(c, &head, &frame, size);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    fuzz_input in = {.data = data, .left = size};
    int ends[2];
    member c;
    port *p = shared_new(&kind, &ways, sizeof(port_shared));
    REQUIRE(p && socketpair(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK, 0, ends) == 0);
    REQUIRE(member_open(&c, &member_socketcand, ends[0], 1));
    const bool fd_node = fuzz_bool(&in);
    bool there = true;
    while (there && in.left > 0) {
        uint8_t piece[PIECE_MAX];
        const unsigned bytes = fuzz_below(&in, PIECE_MAX) + 1;
        for (unsigned i = 0; i < bytes; i++)
            piece[i] = in.left > 0 ? fuzz_u8(&in) : '>';
        REQUIRE(send(ends[1], piece, bytes, 0) == (ssize_t)bytes);
        there = read_all(p, &c, ends[1], fd_node);
        if (there)
            send_some(&c, &in);
    }
    member_close(&c);
    check_answers(ends[1]);
    (void)close(ends[1]);
    port_close(p);
    return 0;
}
