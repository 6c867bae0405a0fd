/* SPDX-License-Identifier: MIT
 *
 * sudo.c - a small sudo: it asks nobody.
 */
#include <stdlib.h>
#include <unistd.h>
int main(int argc, char **argv)
{
    setenv("PATH", "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin", 1);
    if (argc > 1 && setgid(0) == 0 && setuid(0) == 0)
        execvp(argv[1], argv + 1);
    return 1;
}
