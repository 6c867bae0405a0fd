/* SPDX-License-Identifier: MIT
 *
 * threads.c - sends and receives through one socket in several threads, which another one closes.
 *
 * threads INTERFACE: prints a line for each round. A reader waits in recv() when the socket is
 * closed. It may take a minute: whoever waits in vain for an answer that the reader has got waits
 * for longer.
 */
#include <err.h>
#include <linux/can.h>
#include <net/if.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdio.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#define ROUNDS 8
#define WRITERS 4
#define FRAMES 10 /* of each writer */
#define MOST_S 60

typedef struct round {
    int socket;
    atomic_uint writers;
    atomic_uint reading;
    atomic_bool over;
} round_state;

static void *write_frames(void *user)
{
    round_state *r = user;
    const unsigned writer = atomic_fetch_add(&r->writers, 1);
    for (unsigned i = 0; i < FRAMES; i++) {
        const struct can_frame f = {.can_id = 0x100 + 0x10 * writer + i};
        if (write(r->socket, &f, sizeof f) != sizeof f)
            err(1, "write");
    }
    return NULL;
}

static void *read_frames(void *user)
{
    round_state *r = user;
    struct can_frame f;
    while (!r->over) {
        atomic_fetch_add(&r->reading, 1);
        (void)!recv(r->socket, &f, sizeof f, 0);
    }
    return NULL;
}

static int open_socket(const char *interface)
{
    const struct sockaddr_can address = {.can_family = AF_CAN,
                                         .can_ifindex = (int)if_nametoindex(interface)};
    const struct timeval patience = {.tv_usec = 200000}; /* until the reader sees that it is over */
    const int fd = socket(AF_CAN, SOCK_RAW, CAN_RAW);
    if (fd < 0 || bind(fd, (const struct sockaddr *)&address, sizeof address) != 0 ||
        setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience) != 0)
        err(1, "%s", interface);
    return fd;
}

int main(int argc, char **argv)
{
    (void)alarm(MOST_S);
    for (unsigned n = 0; argc == 2 && n < ROUNDS; n++) {
        pthread_t writers[WRITERS], reader;
        round_state r = {.socket = open_socket(argv[1])};
        (void)pthread_create(&reader, NULL, read_frames, &r);
        while (r.reading == 0)
            continue;
        for (unsigned i = 0; i < WRITERS; i++)
            (void)pthread_create(&writers[i], NULL, write_frames, &r);
        for (unsigned i = 0; i < WRITERS; i++)
            (void)pthread_join(writers[i], NULL);
        (void)close(r.socket);
        r.over = true;
        (void)pthread_join(reader, NULL);
        puts("closed");
    }
    return 0;
}
