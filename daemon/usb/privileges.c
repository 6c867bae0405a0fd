/* SPDX-License-Identifier: MIT
 *
 * privileges.c - gives up what root may do.
 */
#include "usb/privileges.h"

#include <errno.h>
#include <grp.h>
#include <linux/capability.h>
#include <pwd.h>
#include <stdint.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <unistd.h>

/* Keeps these capabilities alone: a set of bits below 32. */
static bool privileges_keep(uint32_t set)
{
    struct __user_cap_header_struct head = {.version = _LINUX_CAPABILITY_VERSION_3};
    const struct __user_cap_data_struct data[_LINUX_CAPABILITY_U32S_3] = {
        {.effective = set, .permitted = set}};
    return syscall(SYS_capset, &head, data) == 0 && prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0;
}

bool privileges_become(const char *user)
{
    errno = 0;
    const struct passwd *found = getpwnam(user);
    if (!found) {
        errno = errno ? errno : ENOENT;
        return false;
    }
    return prctl(PR_SET_KEEPCAPS, 1, 0, 0, 0) == 0 && initgroups(user, found->pw_gid) == 0 &&
           setresgid(found->pw_gid, found->pw_gid, found->pw_gid) == 0 &&
           setresuid(found->pw_uid, found->pw_uid, found->pw_uid) == 0 &&
           privileges_keep(UINT32_C(1) << CAP_NET_ADMIN);
}

bool privileges_drop_all(void)
{
    return privileges_keep(0);
}
