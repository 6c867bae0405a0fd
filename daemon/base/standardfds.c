/* SPDX-License-Identifier: MIT
 *
 * standardfds.c - holds the descriptors 0 to 2.
 */
#include "base/standardfds.h"

#include <errno.h>
#include <fcntl.h>
#include <unistd.h>

void standardfds_hold(void)
{
    for (int fd = STDIN_FILENO; fd <= STDERR_FILENO; fd++) {
        if (fcntl(fd, F_GETFD) >= 0 || errno != EBADF)
            continue;
        const int held = open("/dev/null", (fd == STDIN_FILENO ? O_WRONLY : O_RDONLY) |
                                           O_NOFOLLOW | O_CLOEXEC);
        if (held > STDERR_FILENO)
            (void)close(held);
    }
}
