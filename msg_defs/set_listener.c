/* Fast DDS's DomainParticipant::set_listener(listener), with a wait that sleeps.
 *
 * rmw_fastrtps takes the listener of a participant away before it deletes it. Fast DDS then waits, without a limit of
 * time, until no discovery callback runs. "Without a limit" becomes a time beyond what a clock of the C++ library can
 * hold: the wait returns at once, again and again, and does not let go of the mutex that the callback needs to end. The
 * thread spins for ever, and the process with it, since Python's lock is held. Seen here with Fast DDS 2.14.5: a node
 * that had not left the graph after ten minutes, on a computer with nothing else to do; reported to Fast DDS as issue
 * 6513. Here the same function of Fast DDS that takes a limit is called, a second at a time.
 *
 * microstage_ros.ros loads this library where Fast DDS 2.14 is; the linker then prefers it to the one of Fast DDS.
 * Without it the above is back, and nothing else changes. */

#define _GNU_SOURCE
#include <dlfcn.h>
#include <stddef.h>

#define FAST_DDS "libfastrtps.so.2.14"
#define WITH_LIMIT \
    "_ZN8eprosima7fastdds3dds17DomainParticipant12set_listenerEPNS1_25DomainParticipantListenerE" \
    "NSt6chrono8durationIlSt5ratioILl1ELl1EEEE"

typedef unsigned (*set_listener_within)(void *participant, void *listener, long seconds);

enum { OK = 0, ERROR = 1 };

unsigned microstage_listeners_set = 0; /* how often it was called; for the test */

unsigned _ZN8eprosima7fastdds3dds17DomainParticipant12set_listenerEPNS1_25DomainParticipantListenerE(
    void *participant, void *listener)
{
    static set_listener_within within = NULL;
    unsigned code = ERROR;

    if (within == NULL) {
        void *library = dlopen(FAST_DDS, RTLD_LAZY | RTLD_NOLOAD);
        within = library ? (set_listener_within)dlsym(library, WITH_LIMIT) : NULL;
        if (within == NULL)
            return ERROR;
    }
    ++microstage_listeners_set;
    do
        code = within(participant, listener, 1);
    while (code != OK);
    return code;
}
