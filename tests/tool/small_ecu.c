/* SPDX-License-Identifier: MIT
 *
 * small_ecu.c - small-ecu INTERFACE: a program as ECUs are. It answers each frame with the next
 * identifier, and says so. It crashes at data DEAD, and never ends at data BEEF.
 */
#include <linux/can.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

static int open_can(const char *name)
{
    const struct sockaddr_can address = {.can_family = AF_CAN,
                                         .can_ifindex = (int)if_nametoindex(name)};
    const int fd = socket(PF_CAN, SOCK_RAW, CAN_RAW);
    if (fd < 0 || bind(fd, (const struct sockaddr *)&address, sizeof address) != 0)
        return -1;
    return fd;
}

static void take(struct can_frame *frame)
{
    printf("got %03X\n", frame->can_id & CAN_SFF_MASK);
    (void)fflush(stdout);
    if (frame->can_dlc >= 2 && memcmp(frame->data, "\xDE\xAD", 2) == 0)
        abort();
    if (frame->can_dlc >= 2 && memcmp(frame->data, "\xBE\xEF", 2) == 0)
        (void)signal(SIGTERM, SIG_IGN);
}

int main(int argc, char **argv)
{
    struct can_frame frame;
    const int fd = open_can(argc > 1 ? argv[1] : "can0");
    if (fd < 0) {
        perror("small-ecu");
        return EXIT_FAILURE;
    }
    printf("small-ecu is ready\n");
    (void)fflush(stdout);
    while (read(fd, &frame, sizeof frame) == sizeof frame) {
        take(&frame);
        frame.can_id++;
        if (write(fd, &frame, sizeof frame) != sizeof frame)
            return EXIT_FAILURE;
    }
    return EXIT_FAILURE;
}
