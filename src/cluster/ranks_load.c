// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Launchers and plug-ins. A launcher is detected by its environment variables; only then is the
// plug-in of its MPI library loaded, so that a run without a launcher needs no MPI.

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core.h"
#include "base/plugin.h"
#include "cluster/rank_calls.h"

// Variables of a launcher: number of processes and number of this one.
typedef struct launcher {
    const char *count, *rank;
    const char *plugin; // NULL: that of whichever library is installed
    bool may_be_srun;   // sets them, for processes of any MPI library
} launcher;

static const launcher launchers[] = {
    {"OMPI_COMM_WORLD_SIZE", "OMPI_COMM_WORLD_RANK", "ranks-openmpi.so", false},
    {"PMI_SIZE", "PMI_RANK", "ranks-mpich.so", true}, // the MPI type pmi2 of srun
    {"SLURM_STEP_NUM_TASKS", "SLURM_PROCID", NULL, true},
};
enum { LAUNCHERS = sizeof launchers / sizeof *launchers };

static int number_of(const char *name, int least)
{
    const char *text = name ? getenv(name) : NULL;
    char *end;
    const long value = text ? strtol(text, &end, 10) : least - 1;
    return text && end != text && !*end && value >= least && value < 65536 ? (int)value : least - 1;
}

static const launcher *find_launcher(int *count)
{
    for (int i = 0; i < LAUNCHERS; ++i) {
        *count = number_of(launchers[i].count, 1);
        if (*count > 0)
            return &launchers[i];
    }
    *count = 1;
    return NULL;
}

int sgs_ranks_launched(int *rank)
{
    int count;
    const launcher *found = find_launcher(&count);
    const int own = found ? number_of(found->rank, 0) : 0;
    if (rank)
        *rank = own > 0 ? own : 0;
    return count;
}

void sgs_ranks_forget_launcher(void)
{
    for (int i = 0; i < LAUNCHERS; ++i)
        unsetenv(launchers[i].count);
}

// Loads a plug-in and joins the ranks. False, with the reason of the last attempt, if it cannot be
// loaded.
static bool try_plugin(const char *folder, const char *name, sgsi_transport *transport,
                       char *reason, size_t bytes)
{
    // Open MPI's own plug-ins look its symbols up globally.
    void *plugin = sgsi_plugin_load(folder, name, true, reason, bytes);
    sgsi_transport_open_fn open_fn;
    if (!plugin || !sgsi_plugin_find(plugin, SGSI_TRANSPORT_OPEN, &open_fn, reason, bytes))
        return false;
    if (open_fn(transport) == SGSI_TRANSPORT_VERSION)
        return true;
    snprintf(reason, bytes, "%s belongs to another version of sparegs", name);
    return false;
}

// Tries the plug-in of the launcher, if it has one, and with `others` those of the other libraries.
// *tried: the last one, to which the reason belongs.
static bool find_plugin(const char *folder, const char *own, bool others, sgsi_transport *transport,
                        const char **tried, char *reason, size_t bytes)
{
    static const char *const names[] = {"ranks-openmpi.so", "ranks-mpich.so"};
    *tried = own;
    if (own && try_plugin(folder, own, transport, reason, bytes))
        return true;
    for (size_t n = 0; n < 2 && others; ++n) {
        if (own && !strcmp(names[n], own))
            continue;
        *tried = names[n];
        if (try_plugin(folder, names[n], transport, reason, bytes))
            return true;
    }
    return false;
}

sgs_status sgs_ranks_open(const char *folder, sgs_ranks **ranks)
{
    int count;
    const launcher *found = find_launcher(&count);
    *ranks = NULL;
    if (count < 2)
        return SGS_STATUS_OK;
    char reason[512] = "it is not installed next to the program or in " SGSI_PLUGIN_DIR;
    sgsi_transport transport;
    const bool slurm =
        found->may_be_srun && (getenv("SLURM_STEP_ID") || getenv("SLURM_STEP_NUM_TASKS"));
    const char *tried;
    if (!find_plugin(folder, found->plugin, !found->plugin || slurm, &transport, &tried, reason,
                     sizeof reason))
        return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                         "%d processes were launched, but the MPI plug-in %s cannot be loaded: %s; "
                         "install libopenmpi-dev (or libmpich-dev) and build sparegs with "
                         "-DSPAREGS_MPI=ON, or start it without a launcher",
                         count, tried, reason);
    if (transport.count == count)
        return sgsi_ranks_create(&transport, ranks);
    transport.close(transport.state);
    return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                     "%d processes were launched, but MPI connects %d of them: the launcher does "
                     "not support the MPI library; %suse the mpirun of the library that sparegs "
                     "was built with",
                     count, transport.count,
                     slurm ? "select another MPI type of srun, of those that 'srun --mpi=list' "
                             "prints (pmix for Open MPI; pmix or pmi2 for MPICH), or "
                           : "");
}
