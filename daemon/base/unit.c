/* SPDX-License-Identifier: MIT
 *
 * unit.c - the service canwired@INSTANCE, whose unit sets CANWIRE_SERVICE to INSTANCE.
 */
#include "base/unit.h"

#include "base/file/folder.h"
#include "base/mounts.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <pthread.h>
#include <pwd.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sysexits.h>
#include <unistd.h>

#define USER_BYTES 64
#define USER_BUFFER 4096 /* for getpwuid_r() */
#define FAILURE_MODE 0640

/* ProtectHome=yes hides the first ones, PrivateTmp=yes has the others anew. */
static const struct {
    const char *folder;
    const char *hint;
} private_folders[] = {
    {"/home/", " (the service does not see /home)"},
    {"/root/", " (the service does not see /root)"},
    {"/run/user/", " (the service does not see /run/user)"},
    {"/tmp/", " (the service has a /tmp of its own)"},
    {"/var/tmp/", " (the service has a /var/tmp of its own)"},
};

#define FOLDERS (sizeof private_folders / sizeof private_folders[0])

static pthread_once_t once = PTHREAD_ONCE_INIT;
static bool is_started, bad_path; /* of the main thread, until it has started */
static char user_hint[USER_BYTES]; /* " (as the user canwire)" */

const char *unit_instance(void)
{
    const char *instance = getenv("CANWIRE_SERVICE");
    return instance && *instance ? instance : NULL;
}

int unit_failure(void)
{
    return unit_instance() && !bad_path ? EX_TEMPFAIL : 1;
}

void unit_blame(int number)
{
    /* EINVAL and ELOOP: something that is not a regular file is there */
    static const int lasting[] = {EROFS,  EACCES,       ENOENT, ENOTDIR,
                                  EISDIR, ENAMETOOLONG, EINVAL, ELOOP, ENOTSOCK};
    for (size_t i = 0; i < sizeof lasting / sizeof lasting[0] && !is_started; i++)
        bad_path = bad_path || number == lasting[i];
}

const char *unit_run_folder(void)
{
    const char *chosen = getenv("CANWIRE_RUN");
    return chosen && *chosen ? chosen : UNIT_RUN_FOLDER;
}

/* Writes the name of the file with the last failure. Returns false outside the service. */
static bool name_failure(char path[PATH_MAX])
{
    const char *instance = unit_instance();
    return instance && snprintf(path, PATH_MAX, "%s/%s.failure", unit_run_folder(), instance) <
                           PATH_MAX;
}

/* The next start has no failure to tell. */
static void forget_failure(void)
{
    char path[PATH_MAX];
    folder at = FOLDER_NONE;
    if (name_failure(path) && folder_open(&at, path) == 0)
        (void)unlinkat(at.fd, at.name, 0);
    folder_close(&at);
}

void unit_started(void)
{
    is_started = true;
    if (unit_instance())
        mounts_remember();
    forget_failure();
}

void unit_failed(const char *why)
{
    char path[PATH_MAX];
    if (unit_failure() != EX_TEMPFAIL || !name_failure(path))
        return;
    const int fd = open(path, O_WRONLY | O_CREAT | O_TRUNC | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC,
                        FAILURE_MODE);
    if (fd < 0)
        return;
    (void)dprintf(fd, "%s\n", why);
    (void)close(fd);
}

/* Returns FOLDERS for none. */
static size_t unit_find_folder(const char *path)
{
    size_t i = 0;
    while (i < FOLDERS && strncmp(path, private_folders[i].folder,
                                  strlen(private_folders[i].folder)) != 0)
        i++;
    return i;
}

const char *unit_private_folder(const char *path)
{
    const size_t i = unit_instance() ? unit_find_folder(path) : FOLDERS;
    return i < FOLDERS ? private_folders[i].folder : NULL;
}

/* Keeps errno: texts that show the hint show that, too. */
static void name_user(void)
{
    const int error = errno;
    char buffer[USER_BUFFER];
    struct passwd entry, *found = NULL;
    (void)getpwuid_r(geteuid(), &entry, buffer, sizeof buffer, &found);
    if (found)
        (void)snprintf(user_hint, sizeof user_hint, " (as the user %.32s)", found->pw_name);
    else
        (void)snprintf(user_hint, sizeof user_hint, " (as the user %lu)",
                       (unsigned long)geteuid());
    errno = error;
}

const char *unit_hint(const char *path, int number)
{
    if (!unit_instance() || (number != ENOENT && number != EACCES && number != EROFS))
        return "";
    const size_t found = path ? unit_find_folder(path) : FOLDERS;
    if (found < FOLDERS)
        return private_folders[found].hint;
    if (number == EROFS)
        return " (the service may write to " UNIT_RUN_FOLDER " and /var/lib/canwire)";
    if (number == ENOENT)
        return "";
    (void)pthread_once(&once, name_user);
    return user_hint;
}
