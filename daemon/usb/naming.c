/* SPDX-License-Identifier: MIT
 *
 * naming.c - gives the interface that the kernel has made for an adapter its name and namespace.
 */
#include "usb/vhci.h"

#include "base/log.h"
#include "port/links.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <linux/magic.h>
#include <stdio.h>
#include <string.h>
#include <sys/vfs.h>
#include <time.h>
#include <unistd.h>

#define LOOKS 1000u /* a look each LOOK_MS: 20 s, also on a machine that has a lot to do */
#define LOOK_MS 20
#define PATH_BYTES 128u
#define NS_PER_MS 1000000L

static void wait_a_little(void)
{
    const struct timespec pause = {.tv_nsec = LOOK_MS * NS_PER_MS};
    (void)nanosleep(&pause, NULL);
}

/* Returns the index of the only interface of a USB device; 0: there is none yet. */
static unsigned find_interface(const char *bus_id)
{
    char path[PATH_BYTES];
    unsigned index = 0;
    (void)snprintf(path, sizeof path, "/sys/bus/usb/devices/%s:1.0/net", bus_id);
    DIR *folder = opendir(path);
    for (struct dirent *entry; folder && index == 0 && (entry = readdir(folder));)
        if (entry->d_name[0] != '.')
            index = if_nametoindex(entry->d_name);
    if (folder)
        (void)closedir(folder);
    return index;
}

unsigned naming_find(int port)
{
    char bus_id[VHCI_BUS_ID_MAX];
    return vhci_bus_id(bus_id, port) ? find_interface(bus_id) : 0;
}

static void print_path(char out[PATH_BYTES], const char *netns)
{
    (void)snprintf(out, PATH_BYTES, "/run/netns/%s", netns);
}

bool naming_has_namespace(const char *netns)
{
    char path[PATH_BYTES];
    struct statfs what;
    print_path(path, netns);
    if (statfs(path, &what) != 0)
        return errno != ENOENT;
    return what.f_type == NSFS_MAGIC; /* else its mount is yet to come, or has gone */
}

/* Waits until the driver has made the interface. Returns its index, 0 when it takes too long. */
static unsigned wait_for_interface(int port)
{
    unsigned index = 0;
    for (unsigned i = 0; index == 0 && i < LOOKS; i++) {
        index = naming_find(port);
        if (index == 0)
            wait_a_little();
    }
    return index;
}

/* Two adapters may have each other's names. So one whose name is taken frees its own. */
static int naming_move(links *l, unsigned index, int port, const char *name, int netns)
{
    char other[IF_NAMESIZE];
    int number = links_move(l, index, name, netns);
    for (unsigned i = 0; number == EEXIST && i < LOOKS; i++) {
        (void)snprintf(other, sizeof other, "canwire-usb%d", port);
        if (i == 0 && netns < 0)
            (void)links_move(l, index, other, -1);
        wait_a_little();
        number = links_move(l, index, name, netns);
    }
    return number;
}

static bool naming_complain(const char *name, const char *what, const char *why)
{
    log_node_error(name, "%s: %s", what, why);
    return false;
}

static bool naming_has_name(unsigned index, const char *name)
{
    char now[IF_NAMESIZE] = "";
    return if_indextoname(index, now) && strcmp(now, name) == 0;
}

bool name_interface(int port, const char *name, const char *netns)
{
    char path[PATH_BYTES];
    const unsigned index = wait_for_interface(port);
    if (index == 0)
        return naming_complain(name, "the kernel makes no interface", "modprobe peak_usb");
    if (!netns && naming_has_name(index, name))
        return true;
    print_path(path, netns ? netns : "");
    const int fd = netns ? open(path, O_RDONLY | O_CLOEXEC) : -1;
    if (netns && fd < 0)
        return naming_complain(name, path, strerror(errno));
    links *l = links_open();
    const int number = l ? naming_move(l, index, port, name, fd) : errno;
    const bool good = number == 0 || naming_complain(name, "the interface cannot have its name",
                                                     l ? links_error(l) : strerror(number));
    links_close(l);
    if (fd >= 0)
        (void)close(fd);
    return good;
}
