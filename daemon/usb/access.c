/* SPDX-License-Identifier: MIT
 *
 * access.c - whether this process may open the socket of a node, and who may.
 */
#include "usb/access.h"

#include <errno.h>
#include <fcntl.h>
#include <grp.h>
#include <pwd.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/types.h>
#include <unistd.h>

#define PATH_BYTES 128u
#define NAME_BYTES 40u
#define MODE_BITS 07777u

bool access_is_denied(const char *path)
{
    return faccessat(AT_FDCWD, path, W_OK, AT_EACCESS) != 0 && errno == EACCES;
}

/* Copies a name, or a number without one. */
static void print_name(char out[NAME_BYTES], const char *name, unsigned number)
{
    if (name)
        (void)snprintf(out, NAME_BYTES, "%s", name);
    else
        (void)snprintf(out, NAME_BYTES, "%u", number);
}

static void print_user(char out[NAME_BYTES], uid_t user)
{
    const struct passwd *found = getpwuid(user);
    print_name(out, found ? found->pw_name : NULL, user);
}

static void print_group(char out[NAME_BYTES], gid_t group)
{
    const struct group *found = getgrgid(group);
    print_name(out, found ? found->gr_name : NULL, group);
}

/* Finds what this process can see of a path: itself, or the folder that it may not enter. */
static bool find_seen(char seen[PATH_BYTES], struct stat *what, const char *path)
{
    (void)snprintf(seen, PATH_BYTES, "%s", path);
    while (stat(seen, what) != 0) {
        char *slash = strrchr(seen, '/');
        if (errno != EACCES || !slash || slash == seen)
            return false;
        *slash = '\0';
    }
    return true;
}

void access_explain(char why[ACCESS_WHY_BYTES], const char *path)
{
    char seen[PATH_BYTES], me[NAME_BYTES], owner[NAME_BYTES], group[NAME_BYTES];
    struct stat what;
    print_user(me, geteuid());
    if (!find_seen(seen, &what, path)) {
        (void)snprintf(why, ACCESS_WHY_BYTES, "user %s may not open %s", me, path);
        return;
    }
    print_user(owner, what.st_uid);
    print_group(group, what.st_gid);
    (void)snprintf(why, ACCESS_WHY_BYTES, "user %s may not %s %s (owner %s, group %s, mode %04o)",
                   me, S_ISDIR(what.st_mode) ? "enter the folder" : "open the socket", seen, owner,
                   group, what.st_mode & MODE_BITS);
}
