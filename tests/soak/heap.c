/* SPDX-License-Identifier: MIT
 *
 * heap.c - to be preloaded into a program with AddressSanitizer: writes the number of allocated
 * bytes.
 *
 * The file $HEAP has the number of bytes, renewed all the time.
 *
 * The memory of the process is less precise: freed memory is kept, and not all of it is returned.
 */
#include <fcntl.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>

#define PERIOD_NS 100000000

size_t __sanitizer_get_current_allocated_bytes(void);

static void *watch(void *unused)
{
    int file = open(getenv("HEAP"), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
    (void)unused;
    for (;;) {
        char text[24];
        int length =
            snprintf(text, sizeof text, "%20zu\n", __sanitizer_get_current_allocated_bytes());
        if (pwrite(file, text, (size_t)length, 0) != length)
            abort();
        nanosleep(&(struct timespec){.tv_nsec = PERIOD_NS}, NULL); /* no polling: a sampler */
    }
    return NULL;
}

__attribute__((constructor)) static void start(void)
{
    pthread_t thread;
    if (pthread_create(&thread, NULL, watch, NULL) != 0)
        abort();
}
