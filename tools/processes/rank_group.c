// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "processes/rank_group.h"

#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "cli/output.h"
#include "cli/progress.h"
#include "options/option_text.h"
#include "options/options.h"
#include "processes/interrupt.h"
#include "processes/rank_cores.h"
#include "sparegs/runtime.h"

static sgs_ranks *ranks;
static int machine_ranks = 1;
static bool told;         // the failure of a call is printed
static int silenced = -1; // standard error of a rank other than 0
static bool cancelled;    // a rank was stopped while it loaded the scene or created the trainer

void group_silence(void)
{
    int rank;
    if (sgs_ranks_launched(&rank) < 2 || !rank)
        return;
    const int nothing = open("/dev/null", O_WRONLY);
    if (nothing < 0)
        return;
    fflush(stdout);
    silenced = fcntl(STDERR_FILENO, F_DUPFD_CLOEXEC, STDERR_FILENO + 1);
    dup2(nothing, STDOUT_FILENO);
    dup2(nothing, STDERR_FILENO);
    close(nothing);
    messages_set_quiet(true);
}

void group_let_lead_speak(int status)
{
    enum { SECONDS = 3 }; // the launcher ends this process when rank 0 has ended
    int rank;
    if (status == EXIT_DONE || sgs_ranks_launched(&rank) < 2 || !rank)
        return;
    sleep(SECONDS);
    char node[64] = "";
    gethostname(node, sizeof node - 1);
    if (silenced >= 0)
        dprintf(silenced, "sparegs: rank %d (%s): %s\n", rank, node, last_error_text());
}

void group_check_binding(void)
{
    if (!ranks || !group_leads())
        return;
    const rank_cores cores = {.own = sgs_cores(),
                              .machine = sysconf(_SC_NPROCESSORS_ONLN),
                              .ranks = machine_ranks,
                              .threads = sgs_threads_get()};
    char *advice = rank_cores_advice(&cores);
    if (advice)
        print_warning("%s", advice);
    free(advice);
}

// Host name, and the boot of its kernel, because machines may have the same name.
static void identify_machine(char key[128])
{
    memset(key, 0, 128);
    gethostname(key, 64);
    key[64] = 0;
    FILE *boot = fopen("/proc/sys/kernel/random/boot_id", "r");
    if (boot) {
        (void)!fread(key + 65, 1, 36, boot);
        fclose(boot);
    }
}

// Counts the ranks on the machine of this one. A failure is that of the next collective call.
static void count_machine_ranks(void)
{
    char own[128];
    identify_machine(own);
    char *all = malloc((size_t)group_count() * sizeof own);
    const sgs_status memory = all ? SGS_STATUS_OK : SGS_STATUS_OUT_OF_MEMORY;
    if (sgs_ranks_gather(ranks, memory, own, sizeof own, all)) {
        free(all);
        return;
    }
    machine_ranks = 0;
    for (int r = 0; r < group_count(); ++r)
        machine_ranks += !memcmp(all + (size_t)r * sizeof own, own, sizeof own);
    free(all);
}

int group_open(const char *command, bool supported)
{
    const int count = sgs_ranks_launched(NULL);
    if (count < 2)
        return -1;
    if (!supported)
        return fail_usage("%s runs in one process; start it without a launcher (%d processes were "
                          "launched)",
                          command, count);
    if (sgs_ranks_open(NULL, &ranks))
        return fail_library();
    sgs_ranks_forget_launcher();
    if (ranks)
        count_machine_ranks();
    return -1;
}

int group_close(int status)
{
    if (!ranks)
        return status;
    // A rank that failed alone, without group_all.
    const bool failed = status == EXIT_FAILED || status == EXIT_USAGE;
    const bool all = group_all(!failed);
    const bool stopped = cancelled && group_stop_requested();
    sgs_ranks_close(ranks);
    ranks = NULL;
    if (stopped)
        return interrupt_status();
    return all || failed ? status : EXIT_FAILED;
}

sgs_ranks *group_ranks(void)
{
    return ranks;
}

bool group_leads(void)
{
    return !ranks || !sgs_ranks_rank(ranks);
}

int group_count(void)
{
    return sgs_ranks_count(ranks);
}

int group_machine_ranks(void)
{
    return machine_ranks;
}

static const struct {
    int number;
    unsigned request;
} signals[] = {{SIGINT, GROUP_INTERRUPT}, {SIGTERM, GROUP_TERMINATE}, {SIGHUP, GROUP_HANG_UP}};
enum { SIGNALS = sizeof signals / sizeof *signals };

static void raise_own_signal(void)
{
    for (size_t k = 0; k < SIGNALS; ++k)
        if (interrupt_signal() == signals[k].number)
            sgs_ranks_raise(ranks, signals[k].request);
}

bool group_all(bool own)
{
    if (!ranks)
        return own;
    raise_own_signal();
    const bool stopped = !own && interrupt_was_cancelled();
    const char *text = stopped ? "stopped before the first iteration" : last_error_text();
    const sgs_status failure = stopped ? SGS_STATUS_CANCELLED : SGS_STATUS_IO;
    const sgs_status status = sgs_ranks_agree_text(ranks, own ? SGS_STATUS_OK : failure, text);
    cancelled = status == SGS_STATUS_CANCELLED;
    if (status && own && group_leads() && !told) {
        told = true;
        fail_library();
    }
    told = told || status;
    return !status;
}

bool group_same_text(char *text)
{
    bool same = text != NULL;
    if (!same)
        fail_run("not enough memory to compare the ranks");
    same = group_all(same);
    if (same && sgs_ranks_compare(ranks, SGS_STATUS_OK, text)) {
        fail_library();
        same = false;
    }
    free(text);
    return same;
}

bool group_same_options(const command_line *line, const char *names)
{
    char *text = NULL;
    size_t size = 0;
    FILE *out = ranks ? open_memstream(&text, &size) : NULL;
    if (!ranks)
        return true;
    if (out)
        options_describe_only(out, line, names);
    if (out && fclose(out)) {
        free(text);
        text = NULL;
    }
    return group_same_text(text);
}

bool group_requested(unsigned request, bool own)
{
    if (!ranks)
        return own;
    if (own)
        sgs_ranks_raise(ranks, request);
    return sgs_ranks_raised(ranks) & request;
}

bool group_taken(unsigned request, bool own)
{
    const bool raised = group_requested(request, own);
    if (raised)
        sgs_ranks_lower(ranks, request);
    return raised;
}

bool group_stop_requested(void)
{
    if (!ranks)
        return interrupt_signal() != 0;
    raise_own_signal();
    for (size_t k = 0; k < SIGNALS; ++k) {
        if (!(sgs_ranks_raised(ranks) & signals[k].request))
            continue;
        interrupt_follow(signals[k].number);
        return true;
    }
    return false;
}

bool group_continues(size_t round, size_t every, bool own)
{
    if (!ranks)
        return own && !interrupt_signal();
    if (round % every)
        return true;
    return group_all(own) && !group_stop_requested();
}

int group_number(int value)
{
    int *all = ranks ? malloc((size_t)group_count() * sizeof *all) : NULL;
    if (ranks && !all)
        fail_run("not enough memory for the ranks");
    if (ranks && group_all(all != NULL) &&
        !sgs_ranks_gather(ranks, SGS_STATUS_OK, &value, sizeof value, all))
        value = all[0];
    free(all);
    return value;
}

bool group_recover(bool own)
{
    sgs_ranks_recover(ranks);
    unsigned char mine = own, *all = ranks ? malloc((size_t)group_count()) : NULL;
    const sgs_status memory = all ? SGS_STATUS_OK : SGS_STATUS_OUT_OF_MEMORY;
    bool everywhere = !ranks ? own : !sgs_ranks_gather(ranks, memory, &mine, 1, all);
    for (int r = 0; r < group_count() && ranks && everywhere; ++r)
        everywhere = all[r];
    free(all);
    return everywhere;
}

json_t *group_json(json_t *value)
{
    if (!ranks)
        return value;
    void *text = group_leads() && value ? json_dumps(value, JSON_REAL_PRECISION(17)) : NULL;
    size_t size = text ? strlen(text) : 0;
    const bool shared = !sgs_ranks_broadcast(ranks, SGS_STATUS_OK, &text, &size);
    if (!group_leads())
        value = shared && size ? json_loadb(text, size, 0, NULL) : NULL;
    if (group_leads() || shared)
        free(text);
    return value;
}

bool group_shares_folder(const char *folder)
{
    if (!ranks)
        return true;
    char *made = format_text("%s/.ranks.XXXXXX", folder), *path = NULL;
    const int file = group_leads() ? mkstemp(made) : -1;
    bool shared = !group_leads() || file >= 0;
    if (!shared)
        fail_run("%s: cannot make a file in this folder", folder);
    json_t *name = group_json(file >= 0 ? json_pack("[s]", made + strlen(folder) + 1) : NULL);
    const char *text = json_string_value(json_array_get(name, 0));
    if (text && !group_leads()) {
        path = format_text("%s/%s", folder, text);
        shared = !access(path, F_OK);
        if (!shared)
            fail_run("%s: not the same folder as on rank 0; all ranks need a shared file system",
                     folder);
    }
    shared = group_all(shared);
    if (file >= 0) {
        close(file);
        unlink(made);
    }
    json_decref(name);
    free(made);
    free(path);
    return shared;
}

// An array of the texts [count][size].
static json_t *read_texts(const char *texts, size_t size)
{
    json_t *root = json_array();
    for (int r = 0; r < group_count(); ++r)
        json_array_append_new(root, json_loads(texts + (size_t)r * size, JSON_DECODE_ANY, NULL));
    return root;
}

json_t *group_gather_json(json_t *value)
{
    if (!ranks)
        return json_pack("[o]", value);
    char *text = value ? json_dumps(value, JSON_ENCODE_ANY) : NULL;
    json_decref(value);
    uint64_t own = text ? strlen(text) + 1 : 0, size = 0;
    uint64_t *sizes = malloc((size_t)group_count() * sizeof *sizes);
    json_t *root = NULL;
    if (group_all(text && sizes) &&
        !sgs_ranks_gather(ranks, SGS_STATUS_OK, &own, sizeof own, sizes)) {
        for (int r = 0; r < group_count(); ++r)
            size = sizes[r] > size ? sizes[r] : size;
        char *padded = calloc(size, 1), *texts = malloc((size_t)group_count() * size);
        if (padded)
            memcpy(padded, text, own);
        if (group_all(padded && texts) &&
            !sgs_ranks_gather(ranks, SGS_STATUS_OK, padded, size, texts) && group_leads())
            root = read_texts(texts, size);
        free(padded);
        free(texts);
    }
    free(text);
    free(sizes);
    return root;
}

json_t *group_traffic(void)
{
    sgs_ranks_traffic own[SGS_RANKS_PURPOSE_COUNT], *all;
    if (!ranks)
        return NULL;
    for (int k = 0; k < SGS_RANKS_PURPOSE_COUNT; ++k)
        own[k] = sgs_ranks_traffic_get(ranks, (sgs_ranks_purpose)k);
    all = malloc((size_t)group_count() * sizeof own);
    if (!all)
        fail_run("not enough memory for the traffic of the ranks");
    const bool shared =
        group_all(all != NULL) && !sgs_ranks_gather(ranks, SGS_STATUS_OK, own, sizeof own, all);
    json_t *root = shared ? json_object() : NULL;
    for (int k = 0; k < SGS_RANKS_PURPOSE_COUNT && shared; ++k) {
        sgs_ranks_traffic sum = {.calls = own[k].calls}; // the same on all ranks
        for (int r = 0; r < group_count(); ++r) {
            sum.messages += all[r * SGS_RANKS_PURPOSE_COUNT + k].messages;
            sum.bytes += all[r * SGS_RANKS_PURPOSE_COUNT + k].bytes;
        }
        json_object_set_new(root, sgs_ranks_purpose_name((sgs_ranks_purpose)k),
                            json_pack("{s:I,s:I,s:I}", "calls", (json_int_t)sum.calls, "messages",
                                      (json_int_t)sum.messages, "bytes", (json_int_t)sum.bytes));
    }
    free(all);
    return root;
}
