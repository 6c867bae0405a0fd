/* SPDX-License-Identifier: MIT
 *
 * cannelloni.c - the formats of cannelloni.
 */
#include "port/tunnel/cannelloni.h"

#include <arpa/inet.h>
#include <string.h>

#define VERSION 2u
#define DATA 0u
#define FD_BIT 0x80u
#define ID_BYTES 4u
#define REMEMBERED_NS INT64_C(5000000000) /* copies of a packet come soon */

/* ---- Frames ---------------------------------------------------------------------------------- */

size_t cannelloni_put_frame(uint8_t out[CANNELLONI_FRAME_MAX], const void *frame, size_t size)
{
    struct canfd_frame copy = {.can_id = 0};
    memcpy(&copy, frame, size);
    const uint32_t id = htonl(copy.can_id);
    const bool fd = size == CANFD_MTU;
    size_t bytes = ID_BYTES;
    memcpy(out, &id, sizeof id);
    out[bytes++] = (uint8_t)(copy.len | (fd ? FD_BIT : 0));
    if (fd)
        out[bytes++] = copy.flags;
    if (copy.can_id & CAN_RTR_FLAG)
        return bytes;
    memcpy(out + bytes, copy.data, copy.len);
    return bytes + copy.len;
}

/* Remote frames have a length and no data. */
int cannelloni_take_frame(struct canfd_frame *out, size_t *size, const uint8_t *in, size_t bytes)
{
    if (bytes <= ID_BYTES)
        return 0;
    uint32_t id;
    memcpy(&id, in, sizeof id);
    const bool fd = in[ID_BYTES] & FD_BIT;
    *out = (struct canfd_frame){.can_id = ntohl(id), .len = in[ID_BYTES] & (uint8_t)~FD_BIT};
    *size = fd ? CANFD_MTU : CAN_MTU;
    if (out->len > (fd ? CANFD_MAX_DLEN : CAN_MAX_DLEN))
        return -1;
    const size_t head = ID_BYTES + 1 + fd;
    const size_t data = out->can_id & CAN_RTR_FLAG ? 0 : out->len;
    if (bytes < head + data)
        return 0;
    if (fd)
        out->flags = in[ID_BYTES + 1];
    memcpy(out->data, in + head, data);
    return (int)(head + data);
}

/* ---- Packets --------------------------------------------------------------------------------- */

/* Writes the head of a packet of frames. All numbers have their high byte first. */
void cannelloni_put_head(uint8_t out[CANNELLONI_HEAD_BYTES], uint8_t number, unsigned frames)
{
    out[0] = VERSION;
    out[1] = DATA;
    out[2] = number;
    out[3] = (uint8_t)(frames >> 8);
    out[4] = (uint8_t)frames;
}

int cannelloni_check(const uint8_t *in, size_t bytes)
{
    struct canfd_frame frame;
    size_t size, place = CANNELLONI_HEAD_BYTES;
    if (bytes < CANNELLONI_HEAD_BYTES || in[0] != VERSION || in[1] != DATA)
        return -1;
    const int count = in[3] << 8 | in[4];
    for (int i = 0; i < count; i++) {
        const int taken = cannelloni_take_frame(&frame, &size, in + place, bytes - place);
        if (taken <= 0)
            return -1;
        place += (size_t)taken;
    }
    return count;
}

/* ---- Sequence numbers ------------------------------------------------------------------------ */

/* FNV-1a */
static uint32_t hash(const uint8_t *bytes, size_t count)
{
    uint32_t h = 2166136261u;
    for (size_t i = 0; i < count; i++)
        h = (h ^ bytes[i]) * 16777619u;
    return h;
}

/* Keeps a packet that has come, in place of an older one, so that a copy is known as such. */
static void remember(cannelloni_sequence *s, uint8_t number, uint32_t content, int64_t ns)
{
    s->seen[number % CANNELLONI_SEEN].there = true;
    s->seen[number % CANNELLONI_SEEN].number = number;
    s->seen[number % CANNELLONI_SEEN].content = content;
    s->seen[number % CANNELLONI_SEEN].ns = ns;
}

/* Judges a packet whose number is not ahead. One that has come before, with another content or
 * long ago, is the first of a peer that has begun again. */
static cannelloni_place judge_old(const cannelloni_sequence *s, uint8_t number, uint32_t content,
                                  int64_t ns)
{
    const uint8_t behind = (uint8_t)(s->next - number);
    const uint8_t last = (uint8_t)(s->next - 1);
    const bool soon = ns - s->seen[last % CANNELLONI_SEEN].ns < REMEMBERED_NS;
    const bool there = s->seen[number % CANNELLONI_SEEN].there &&
                       s->seen[number % CANNELLONI_SEEN].number == number;
    if (behind > CANNELLONI_SEEN || !soon)
        return CANNELLONI_RESTART;
    if (!there)
        return CANNELLONI_LATE;
    return s->seen[number % CANNELLONI_SEEN].content == content ? CANNELLONI_DUPLICATE
                                                                : CANNELLONI_RESTART;
}

/* Forgets the places of packets that are missing: older ones with the same remainder are there. */
static void cannelloni_forget(cannelloni_sequence *s, uint8_t first, unsigned count)
{
    for (unsigned i = 0; i < count && i < CANNELLONI_SEEN; i++)
        s->seen[(first + i) % CANNELLONI_SEEN].there = false;
}

cannelloni_place cannelloni_follow(cannelloni_sequence *s, const uint8_t *in, size_t bytes,
                                   int64_t ns, unsigned *missing)
{
    const uint8_t number = in[2];
    const uint32_t content = hash(in, bytes);
    const uint8_t ahead = s->begun ? (uint8_t)(number - s->next) : 0;
    cannelloni_place place = CANNELLONI_NEXT;
    *missing = 0;
    if (ahead >= 128)
        place = judge_old(s, number, content, ns);
    else
        *missing = ahead;
    if (place == CANNELLONI_RESTART)
        memset(s, 0, sizeof *s);
    cannelloni_forget(s, s->next, *missing);
    if (place != CANNELLONI_DUPLICATE)
        remember(s, number, content, ns);
    if (place == CANNELLONI_NEXT || place == CANNELLONI_RESTART)
        s->next = (uint8_t)(number + 1);
    s->begun = true;
    return place;
}
