/* SPDX-License-Identifier: MIT
 *
 * ecus.c - the ECUs of all buses, in one thread.
 *
 * To keep a bus at 100 % load, ECUs have WINDOW frames under way each. A frame that reaches the ECU
 * of the next node makes that one send another. So none goes on for ever with its low identifiers
 * while others wait; all frames may be in one queue then. Frames are numbered; every ECU checks the
 * order of the frames of each other one.
 *
 * One thread for all must cost less than the buses. So it reads and sends many frames in one call,
 * and sleeps between its rounds.
 */
#include "realtime.h"

#include <errno.h>
#include <linux/can.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#define WINDOW (RT_QUEUE / RT_NODES - 1) /* frames of an ECU at the start */
#define BATCH 64u
#define ROUND_NS 500000 /* the ECUs look at their sockets in rounds, as many programs would */
#define LAST_NS (30 * RT_NS_PER_S) /* for the last frames to come; they take some milliseconds */

typedef struct crowd {
    rt_ecu *ecus;
    unsigned count;
    int epoll;
    bool answer; /* send another one for each that came */
} crowd;

/* Makes a frame. The identifier changes from frame to frame, so that all nodes get their turn. */
static struct can_frame make_frame(const rt_ecu *e)
{
    struct can_frame f = {.can_id = (e->sent * 5 + e->node * 3) % 0x1FF * RT_NODES + e->node,
                          .len = 8};
    uint64_t content = (e->sent + UINT64_C(1)) * UINT64_C(0x9E3779B97F4A7C15);
    memcpy(f.data, &e->sent, sizeof e->sent);
    memcpy(f.data + 4, (const unsigned char *)&content + 4, 4);
    return f;
}

/* Points message headers at an array of frames. */
static void point_at(struct mmsghdr *messages, struct iovec *vectors, struct can_frame *frames)
{
    for (unsigned i = 0; i < BATCH; i++) {
        vectors[i] = (struct iovec){.iov_base = &frames[i], .iov_len = sizeof frames[i]};
        messages[i] = (struct mmsghdr){.msg_hdr = {.msg_iov = &vectors[i], .msg_iovlen = 1}};
    }
}

/* Sends the next frames of an ECU, which owes them. */
static void send_owed(rt_ecu *e)
{
    struct mmsghdr messages[BATCH];
    struct iovec vectors[BATCH];
    struct can_frame frames[BATCH];
    point_at(messages, vectors, frames);
    while (e->owed > 0) {
        const unsigned count = e->owed < BATCH ? e->owed : BATCH;
        for (unsigned i = 0; i < count; i++, e->sent++)
            frames[i] = make_frame(e);
        for (int done = 0, sent; done < (int)count; done += sent) {
            sent = sendmmsg(e->fd, messages + done, count - (unsigned)done, MSG_NOSIGNAL);
            if (sent < 1)
                rt_fail("an ECU cannot send: %s", strerror(errno));
        }
        e->owed -= count;
    }
}

static void take_frame(const crowd *c, rt_ecu *e, const struct can_frame *f)
{
    uint32_t number;
    unsigned sender = f->can_id % RT_NODES;
    if (f->can_id & CAN_ERR_FLAG) /* lost arbitrations */
        return;
    memcpy(&number, f->data, sizeof number);
    e->received++;
    e->wrong += number != e->expected[sender];
    e->expected[sender] = number + 1;
    if (c->answer && (sender + 1) % RT_NODES == e->node)
        e->owed++;
}

static void read_ecu(crowd *c, rt_ecu *e, bool numbered)
{
    struct mmsghdr messages[BATCH];
    struct iovec vectors[BATCH];
    struct can_frame frames[BATCH];
    point_at(messages, vectors, frames);
    int count = recvmmsg(e->fd, messages, BATCH, MSG_DONTWAIT, NULL);
    for (int i = 0; i < count; i++) {
        if (messages[i].msg_len != sizeof frames[i])
            rt_fail("the bus of an ECU has gone");
        if (numbered)
            take_frame(c, e, &frames[i]);
    }
}

static void watch(crowd *c)
{
    c->epoll = epoll_create1(EPOLL_CLOEXEC);
    for (unsigned i = 0; i < c->count; i++) {
        struct epoll_event event = {.events = EPOLLIN, .data.u32 = i};
        if (c->ecus[i].fd >= 0 && epoll_ctl(c->epoll, EPOLL_CTL_ADD, c->ecus[i].fd, &event) != 0)
            rt_fail("epoll: %s", strerror(errno));
    }
}

static bool all_have_come(const crowd *c)
{
    for (unsigned i = 0; i < c->count; i++)
        for (unsigned node = 0; node < RT_NODES; node++) {
            const rt_ecu *e = &c->ecus[i];
            const rt_ecu *sender = &c->ecus[e->bus * RT_NODES + node];
            if (node != e->node && e->expected[node] != sender->sent)
                return false;
        }
    return true;
}

static void send_all_owed(const crowd *c)
{
    for (unsigned i = 0; i < c->count; i++)
        send_owed(&c->ecus[i]);
}

static void sleep_until_round(void)
{
    const int64_t ns = (rt_now_ns() / ROUND_NS + 1) * ROUND_NS;
    const struct timespec at = {.tv_sec = ns / RT_NS_PER_S, .tv_nsec = ns % RT_NS_PER_S};
    (void)clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &at, NULL); /* no polling: a load */
}

static void run_until(crowd *c, int64_t end_ns, bool numbered)
{
    struct epoll_event events[RT_BUSES_MAX * RT_NODES];
    while (rt_now_ns() < end_ns) {
        int count = epoll_wait(c->epoll, events, RT_BUSES_MAX * RT_NODES, 10);
        for (int i = 0; i < count; i++)
            read_ecu(c, &c->ecus[events[i].data.u32], numbered);
        send_all_owed(c);
        if (numbered)
            sleep_until_round();
        if (numbered && !c->answer && all_have_come(c))
            return;
    }
}

void rt_saturate(rt_ecu *ecus, unsigned count, int64_t duration_ns)
{
    crowd c = {.ecus = ecus, .count = count, .answer = true};
    watch(&c);
    for (unsigned i = 0; i < count; i++)
        ecus[i].owed = WINDOW;
    send_all_owed(&c);
    run_until(&c, rt_now_ns() + duration_ns, true);
    c.answer = false;
    run_until(&c, rt_now_ns() + LAST_NS, true);
    (void)close(c.epoll);
}

void rt_listen(rt_ecu *ecus, unsigned count, int64_t duration_ns)
{
    crowd c = {.ecus = ecus, .count = count};
    watch(&c);
    run_until(&c, rt_now_ns() + duration_ns, false);
    (void)close(c.epoll);
}
