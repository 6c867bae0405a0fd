/* SPDX-License-Identifier: MIT
 *
 * test_tunnel.c - a tunnel over TCP whose peer goes: what it has sent is read and counted, and no
 * frame for it counts as written.
 */
#include "port_rig.h"

#include "port/tunnel/cannelloni.h"
#include "port/kinds.h"

#include <arpa/inet.h>
#include <poll.h>

#define FRAMES 3
#define FRAME_BYTES 5 /* of an empty frame with a base identifier */

/* Returns a port number that is free. */
static uint16_t free_number(void)
{
    struct sockaddr_in address = {.sin_family = AF_INET,
                                  .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    socklen_t size = sizeof address;
    const int fd = socket(AF_INET, SOCK_STREAM, 0);
    assert_int_equal(bind(fd, (struct sockaddr *)&address, size), 0);
    assert_int_equal(getsockname(fd, (struct sockaddr *)&address, &size), 0);
    close(fd);
    return ntohs(address.sin_port);
}

static int connect_peer(uint16_t number)
{
    const struct sockaddr_in address = {.sin_family = AF_INET, .sin_port = htons(number),
                                        .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    const int fd = socket(AF_INET, SOCK_STREAM, 0);
    assert_int_equal(connect(fd, (const struct sockaddr *)&address, sizeof address), 0);
    return fd;
}

static unsigned take(port *p)
{
    port_frame frames[PORT_BATCH];
    bool more;
    return port_read(p, frames, PORT_BATCH, &more);
}

static port_tunnel_info info_of(const port *p)
{
    port_tunnel_info info;
    assert_true(port_tunnel(p, &info));
    return info;
}

/* Opens a port, and connects its peer, up to the greetings. */
static port *open_port(int *peer)
{
    const uint16_t number = free_number();
    char name[96], error[PORT_ERROR_TEXT_MAX], greeting[CANNELLONI_GREETING_BYTES];
    (void)snprintf(name, sizeof name, "cannelloni:tcp,listen=127.0.0.1:%u,mtu=%u,timeout=1s",
                   number, 576);
    port *p = port_tunnel_open(name, error);
    if (!p)
        fail_msg("%s", error);
    *peer = connect_peer(number);
    assert_int_equal(send(*peer, CANNELLONI_GREETING, CANNELLONI_GREETING_BYTES, 0),
                     CANNELLONI_GREETING_BYTES);
    for (unsigned i = 0; i < 1000 && strcmp(info_of(p).state, "up") != 0; i++)
        (void)take(p);
    assert_string_equal(info_of(p).state, "up");
    assert_int_equal(recv(*peer, greeting, sizeof greeting, MSG_WAITALL), sizeof greeting);
    return p;
}

/* The frames that filled a packet are lost, and the next one is not heard. */
TEST(a_peer_that_goes_is_found_where_room_is_made)
{
    int peer;
    port *p = open_port(&peer);
    const cw_frame frame = rig_frame(0x123, 0, 0);
    const unsigned full = 576 / FRAME_BYTES;
    uint8_t bytes[FRAMES * FRAME_BYTES];
    for (unsigned i = 0; i < full; i++)
        assert_true(port_write(p, &frame));
    assert_int_equal(stats_of(p).written, full);
    for (unsigned i = 0; i < FRAMES; i++)
        memcpy(bytes + i * FRAME_BYTES, (const uint8_t[]){0, 0, 1, 0x23, 0}, FRAME_BYTES);
    const uint64_t read_before = info_of(p).packets_read;
    assert_int_equal(send(peer, bytes, sizeof bytes, 0), sizeof bytes);
    close(peer); /* on one machine the other end knows of it at once */
    (void)port_write(p, &frame);
    assert_string_equal(info_of(p).state, "waiting");
    const port_stats stats = stats_of(p);
    assert_int_equal(stats.written, 0);
    assert_int_equal(stats.write_failed, full);
    assert_int_equal(stats.unheard, 1);
    assert_int_equal(take(p), FRAMES);
    assert_int_equal(info_of(p).packets_read, read_before + 1);
    assert_int_equal(stats_of(p).read, FRAMES);
    port_close(p);
}
