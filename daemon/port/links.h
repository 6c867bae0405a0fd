/* SPDX-License-Identifier: MIT
 *
 * links.h - network interfaces, through rtnetlink: to look at, to make and to remove.
 *
 * Functions return 0 or an errno; what the kernel says to it is in links_error(). All but looking
 * needs CAP_NET_ADMIN.
 */
#ifndef CANWIRE_PORT_LINKS_H
#define CANWIRE_PORT_LINKS_H

#include <linux/can.h>
#include <net/if.h>
#include <stdbool.h>
#include <stdint.h>

#define LINKS_KIND_BYTES 16u
#define LINKS_ALIAS_BYTES 256u /* with the final 0; the kernel takes no more */

/* Of the interfaces that are made: the bus is classical, so the kernel refuses CAN FD frames. It
 * can be changed only while an interface is down. */
#define LINKS_MTU CAN_MTU

typedef struct links links;

typedef struct link_info {
    char name[IF_NAMESIZE];
    char kind[LINKS_KIND_BYTES];   /* vcan, vxcan, ...; empty for hardware without */
    char alias[LINKS_ALIAS_BYTES]; /* empty: none */
    uint32_t mtu;
    bool up;
} link_info;

/* NULL with errno set. */
links *links_open(void);

/* NULL is fine. */
void links_close(links *l);

/* ENODEV: there is none of this name. */
int links_find(links *l, link_info *info, const char *name);

/* Calls back for each interface until it returns false; it must not use l. */
typedef bool links_visitor(void *user, const link_info *info);
int links_each(links *l, links_visitor *visit, void *user);

/* A vcan interface, up, with LINKS_MTU. */
int links_make_vcan(links *l, const char *name);

/* A pair of vxcan interfaces with LINKS_MTU; the peer is up and in the namespace of a file, or -1:
 * in this one. */
int links_make_vxcan(links *l, const char *name, const char *peer, int netns_fd);

/* Sets an interface up and gives it an alias, NULL: as it is. */
int links_set(links *l, const char *name, const char *alias);

/* A vxcan's peer goes with it. */
int links_remove(links *l, const char *name);

/* Why the last call failed, for people. */
const char *links_error(const links *l);

/* Whether the kernel was asked then and its answer could not be read: it may have been done. */
bool links_unanswered(const links *l);

#endif
