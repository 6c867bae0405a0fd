/* SPDX-License-Identifier: MIT
 *
 * links.h - finds, makes and removes network interfaces through rtnetlink.
 *
 * Functions return 0 or an errno; links_error() has the kernel's text. All functions that change
 * interfaces need CAP_NET_ADMIN.
 */
#ifndef CANWIRE_PORT_LINKS_H
#define CANWIRE_PORT_LINKS_H

#include <linux/can.h>
#include <net/if.h>
#include <stdbool.h>
#include <stdint.h>

#define LINKS_KIND_BYTES 16u
#define LINKS_ALIAS_BYTES 256u /* with the final 0; the kernel's limit */

typedef struct links links;

typedef struct link_info {
    char name[IF_NAMESIZE];
    char kind[LINKS_KIND_BYTES];   /* vcan, vxcan, ...; empty for most hardware */
    char alias[LINKS_ALIAS_BYTES]; /* empty: none */
    uint32_t mtu;
    unsigned index;
    bool up;
} link_info;

/* Opens a socket. Returns NULL with errno set. */
links *links_open(void);

/* Closes it. NULL is allowed. */
void links_close(links *l);

/* Finds an interface. ENODEV: there is none of this name. */
int links_find(links *l, link_info *info, const char *name);

/* Receives each interface until it returns false; it must not use l. */
typedef bool links_visitor(void *user, const link_info *info);
int links_each(links *l, links_visitor *visit, void *user);

/* Makes a vcan interface and sets it up. mtu: CAN_MTU, with which the kernel refuses CAN FD frames,
 * or CANFD_MTU. */
int links_make_vcan(links *l, const char *name, unsigned mtu);

/* Makes a pair of vxcan interfaces, both with this MTU. The peer is up, in the namespace of
 * netns_fd, -1: in this one. */
int links_make_vxcan(links *l, const char *name, const char *peer, int netns_fd, unsigned mtu);

/* Changes the MTU of an interface, which is down for a moment, and sets it up. When that fails, it
 * is up if it was up before. */
int links_set_mtu(links *l, const char *name, unsigned mtu);

/* Sets an interface up and gives it an alias; NULL keeps the alias. */
int links_set(links *l, const char *name, const char *alias);

/* Renames an interface that is down, and moves it into the namespace of netns_fd, unless that is
 * -1. index: of the interface. */
int links_move(links *l, unsigned index, const char *name, int netns_fd);

/* Removes an interface, and with it the peer of a vxcan. */
int links_remove(links *l, const char *name);

/* Returns the reason of the last failure as a text. */
const char *links_error(const links *l);

/* Returns true when the kernel's answer to that call could not be read: the change may have
 * happened. */
bool links_unanswered(const links *l);

#endif
