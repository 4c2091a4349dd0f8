// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "plan/run_settings.h"

#include <stdlib.h>
#include <string.h>

#include "cli/json_file.h"
#include "cli/json_output.h"
#include "cli/output.h"
#include "cli/progress.h"
#include "sparegs/runtime.h"

// Options that may change between sessions, because the model does not depend on them; times do.
// The instruction set is checked by isa_agrees.
static bool is_free(const char *key)
{
    static const char *const names[] = {"threads",    "isa",        "image_cache",
                                        "max_memory", "time_limit", "checkpoint_every",
                                        "save_at",    "trace"};
    for (size_t k = 0; k < sizeof names / sizeof *names; ++k)
        if (!strcmp(key, names[k]))
            return true;
    return false;
}

json_t *run_settings_load(const experiment_run *run, const char *name)
{
    char *path = format_text("%s/%s", run->folder, name);
    json_t *root = load_json(path, 0, NULL);
    free(path);
    return root;
}

static bool fail_changed(const experiment_run *run, const char *name, const json_t *old,
                         const json_t *now)
{
    char *was = old ? json_dumps(old, JSON_ENCODE_ANY) : NULL;
    char *is = now ? json_dumps(now, JSON_ENCODE_ANY) : NULL;
    fail_run("%s: was trained with %s %s, but the plan has %s; use another -o DIR, or delete this "
             "folder to train again",
             run->folder, name, was ? was : "none", is ? is : "none");
    free(was);
    free(is);
    return false;
}

static bool same_members(const experiment_run *run, json_t *old, json_t *now)
{
    json_t *all = json_object();
    json_object_update(all, old);
    json_object_update(all, now);
    const char *key;
    json_t *value;
    bool same = true;
    json_object_foreach(all, key, value)
    {
        const json_t *was = json_object_get(old, key), *is = json_object_get(now, key);
        if (!same || is_free(key) || json_equal(was, is))
            continue;
        same = json_is_object(was) && json_is_object(is)
                   ? same_members(run, json_object_get(old, key), json_object_get(now, key))
                   : fail_changed(run, key, was, is);
    }
    json_decref(all);
    return same;
}

static const char *isa_now(const char *given)
{
    return given ? given : sgs_isa_name(sgs_isa_get());
}

// The baseline of x86-64 has no fused multiply-add; the others compute the same bits.
static bool fuses(const char *isa)
{
#ifdef __x86_64__
    return strcmp(isa, sgs_isa_name(SGS_ISA_BASELINE)) != 0;
#else
    (void)isa;
    return true;
#endif
}

static bool isa_agrees(const experiment_run *run)
{
    json_t *config = run_settings_load(run, "config.json");
    const char *was = json_string_value(json_object_get(config, "isa")),
               *is = isa_now(experiment_run_argument(run, "isa"));
    const bool agrees = !was || fuses(was) == fuses(is);
    if (!agrees)
        fail_run("%s: was trained with isa %s, but the experiment now uses %s, which gives another "
                 "model; set --isa, use another -o DIR, or delete this folder to train again",
                 run->folder, was, is);
    json_decref(config);
    return agrees;
}

bool run_settings_agree(const experiment_run *run)
{
    json_t *old = run_settings_load(run, "experiment.json");
    json_object_del(old, "sessions");
    if (json_is_object(json_object_get(old, "options"))) { // earlier builds stored no settings
        json_object_set_new(old, "options",
                            experiment_plan_options(json_object_get(old, "options")));
        experiment_run_drop_idle(run, json_object_get(old, "options"));
    }
    const bool agrees = (!old || same_members(run, old, run->settings)) && isa_agrees(run);
    json_decref(old);
    return agrees;
}

// ---- Sessions ----

static const char *const session_members[] = {"threads", "isa", "commit"};
enum { SESSION_MEMBERS = sizeof session_members / sizeof *session_members };

json_t *session_of(const char *threads, const char *isa)
{
    const int given = threads ? atoi(threads) : 0; // 0: all cores, as without the option
    return json_pack("{s:i,s:s,s:s}", "threads", given > 0 ? given : sgs_threads_get(), "isa",
                     isa_now(isa), "commit", sgs_version_commit());
}

static json_t *session_now(const experiment_run *run)
{
    return session_of(experiment_run_argument(run, "threads"), experiment_run_argument(run, "isa"));
}

// The session that config.json records, or NULL if the run was not started.
static json_t *session_of_config(const experiment_run *run)
{
    json_t *config = run_settings_load(run, "config.json"),
           *session = config ? json_object() : NULL;
    for (int k = 0; k < SESSION_MEMBERS && config; ++k)
        json_object_set(session, session_members[k], json_object_get(config, session_members[k]));
    json_decref(config);
    return session;
}

// The different sessions so far. Never NULL.
static json_t *earlier_sessions(const experiment_run *run)
{
    json_t *settings = run_settings_load(run, "experiment.json");
    json_t *list = json_incref(json_object_get(settings, "sessions"));
    json_decref(settings);
    if (json_is_array(list))
        return list;
    json_decref(list);
    list = json_array();
    json_t *session = session_of_config(run); // of an earlier build
    if (session)
        json_array_append_new(list, session);
    return list;
}

// Steals `sessions`.
static bool write_settings(const experiment_run *run, json_t *sessions)
{
    json_t *settings = json_copy(run->settings);
    json_object_set_new(settings, "sessions", sessions);
    char *path = format_text("%s/experiment.json", run->folder);
    const bool written = make_folder(run->folder) && write_json(path, json_incref(settings));
    json_decref(settings);
    free(path);
    return written;
}

// How often the training has resumed from a checkpoint. *iteration receives that of the last one.
static size_t count_resumes(const experiment_run *run, int *iteration)
{
    json_t *config = run_settings_load(run, "config.json"),
           *resumed = json_object_get(config, "resumed");
    const size_t count = json_array_size(resumed);
    const json_t *last = count ? json_array_get(resumed, count - 1) : NULL;
    *iteration = (int)json_integer_value(json_object_get(last, "iteration"));
    json_decref(config);
    return count;
}

bool run_settings_start(const experiment_run *run, bool continues, session_start *start)
{
    int iteration;
    start->sessions = continues ? earlier_sessions(run) : json_array();
    start->resumes = count_resumes(run, &iteration);
    start->continues = continues;
    json_t *now = session_now(run), *sessions = json_copy(start->sessions);
    bool known = false;
    for (size_t k = 0; k < json_array_size(sessions); ++k)
        known = known || json_equal(json_array_get(sessions, k), now);
    if (!known)
        json_array_append(sessions, now);
    json_decref(now);
    const bool written = write_settings(run, sessions);
    if (!written)
        json_decref(start->sessions);
    return written;
}

bool run_settings_finish(const experiment_run *run, session_start *start, int saved)
{
    int first = 0;
    const bool began = !start->continues || count_resumes(run, &first) > start->resumes;
    json_t *sessions = start->sessions;
    start->sessions = NULL;
    if (!began || saved <= first)
        return write_settings(run, sessions);
    json_decref(sessions);
    return true;
}

json_t *run_settings_sessions(const experiment_run *run, const json_t *summary)
{
    json_t *settings = run_settings_load(run, "experiment.json");
    json_t *list = json_object_get(settings, "sessions");
    bool differs = json_array_size(list) > 1;
    for (int k = 0; k < SESSION_MEMBERS && json_array_size(list) == 1; ++k)
        differs =
            differs || !json_equal(json_object_get(json_array_get(list, 0), session_members[k]),
                                   json_object_get(summary, session_members[k]));
    list = json_is_array(list) && differs ? json_incref(list) : NULL;
    json_decref(settings);
    return list;
}

static char *text_of(const json_t *value)
{
    return json_is_string(value) ? format_text("%s", json_string_value(value))
                                 : format_text("%.0f", json_number_value(value));
}

// "threads 1, the remaining runs use 2", or NULL if the sessions agree.
static char *change_text(const json_t *before, const json_t *now)
{
    char *change = NULL;
    for (int k = 0; k < SESSION_MEMBERS && !change; ++k) {
        const json_t *was = json_object_get(before, session_members[k]),
                     *is = json_object_get(now, session_members[k]);
        if (!was || json_equal(was, is))
            continue;
        char *old = text_of(was), *new = text_of(is);
        change = format_text("%s %s, the remaining runs use %s", session_members[k], old, new);
        free(old);
        free(new);
    }
    return change;
}

char *run_settings_change(const experiment_run *run)
{
    json_t *before = earlier_sessions(run), *now = session_now(run);
    char *change = NULL;
    for (size_t k = 0; k < json_array_size(before) && !change; ++k)
        change = change_text(json_array_get(before, k), now);
    json_decref(before);
    json_decref(now);
    return change;
}
