// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "blocks/block_scripts.h"

#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "cli/output.h"
#include "cli/progress.h"
#include "cli/reported_files.h"

// Common to both scripts. Slurm sends SIGUSR2 to the shell 300 s before the limit (B: the shell
// only): sparegs saves its state and exits with 143, and the job is requeued. SIGTERM comes from
// scancel, which ends the job, or from a pre-emption, after which Slurm requeues the job itself.
static const char body[] =
    "set -u\n"
    "scene=${SCENE:-%s}\n"
    "folder=%s\n"
    "if [ ! -e \"$folder/blocks.json\" ]; then # moved; under sbatch, this is a copy elsewhere\n"
    "    place=$(dirname \"$0\")\n"
    "    if [ ! -e \"$place/blocks.json\" ]; then place=${SLURM_SUBMIT_DIR:-$place}; fi\n"
    "    if [ ! -e \"$place/blocks.json\" ]; then\n"
    "        echo \"$folder: no blocks.json here or in $place; start the script next to it\" >&2\n"
    "        exit 1\n"
    "    fi\n"
    "    folder=$(realpath \"$place\")\n"
    "fi\n"
    "sparegs=${SPAREGS:-sparegs}\n"
    "\n"
    "# train OUT OPTION...: starts a training run or continues it. Returns its exit status.\n"
    "train() {\n"
    "    local out=$1 status=0 requeue=\n"
    "    shift\n"
    "    if [ -e \"$out/config.json\" ]; then set -- \"$@\" --resume; fi\n"
    "    \"$sparegs\" train \"$scene\" -o \"$out\" \"$@\" &\n"
    "    local pid=$!\n"
    "    trap 'requeue=1; kill -USR2 $pid' USR2\n"
    "    trap 'requeue=; kill -TERM $pid' TERM INT\n"
    "    wait \"$pid\"\n"
    "    while kill -0 \"$pid\" 2>/dev/null; do wait \"$pid\"; done # a signal ends a wait\n"
    "    wait \"$pid\" || status=$?\n"
    "    trap - USR2 TERM INT\n"
    "    if [ -n \"$requeue\" ] && [ \"$status\" -eq 143 ] && [ -n \"${SLURM_JOB_ID:-}\" ]; then\n"
    "        local job=$SLURM_JOB_ID\n"
    "        if [ -n \"${SLURM_ARRAY_JOB_ID:-}\" ]; then # the ID of a task may be that of all\n"
    "            job=${SLURM_ARRAY_JOB_ID}_$SLURM_ARRAY_TASK_ID\n"
    "        fi\n"
    "        scontrol requeue \"$job\"\n"
    "    fi\n"
    "    return \"$status\"\n"
    "}\n"
    "\n";

static const char settings[] = "#SBATCH --nodes=1\n"
                               "#SBATCH --ntasks=1\n"
                               "#SBATCH --exclusive\n"
                               "#SBATCH --mem=0\n"
                               "#SBATCH --requeue\n"
                               "#SBATCH --open-mode=append\n"
                               "#SBATCH --signal=B:USR2@300\n";

// The absolute path, quoted for the shell. NULL after printing the error.
static char *quoted_path(const char *path)
{
    char *real = realpath(path, NULL);
    if (!real) {
        fail_run("%s: cannot be found", path);
        return NULL;
    }
    char *quoted = calloc(4 * strlen(real) + 3, 1), *to = quoted;
    if (!quoted)
        exit(fail_run("out of memory"));
    *to++ = '\'';
    for (const char *from = real; *from; ++from)
        to = *from == '\'' ? stpcpy(to, "'\\''") : (*to = *from, to + 1);
    *to = '\'';
    free(real);
    return quoted;
}

static bool write_script(const char *folder, const char *name, const char *text)
{
    char *path = format_text("%s/%s", folder, name);
    const bool written = write_text(path, text);
    if (written && chmod(path, 0755))
        print_warning("%s: cannot be made executable", path);
    if (written)
        report_file(path);
    free(path);
    return written;
}

bool block_scripts_write(const char *folder, const char *scene, size_t blocks)
{
    char *place = quoted_path(folder), *data = quoted_path(scene);
    char *common = place && data ? format_text(body, data, place) : NULL;
    bool written = false;
    if (common) {
        char *coarse = format_text("#!/bin/bash\n#SBATCH --job-name=sparegs-coarse\n%s\n"
                                   "# Trains the coarse model of the whole scene that the blocks "
                                   "start from. Arguments are\n"
                                   "# options of 'sparegs train':\n"
                                   "#   sbatch coarse.sh --iterations 7000 --downscale 4\n"
                                   "%strain \"$folder/coarse\" \"$@\"\n",
                                   settings, common);
        char *array = format_text(
            "#!/bin/bash\n#SBATCH --job-name=sparegs-block\n#SBATCH --array=0-%zu\n%s\n"
            "# Trains the blocks. Arguments are options of 'sparegs train':\n"
            "#   sbatch blocks.sh --iterations 30000     one task per block\n"
            "#   bash blocks.sh --iterations 30000       one block after the other\n"
            "# The coarse model is coarse/ or $COARSE, a run folder or a PLY file.\n"
            "%scoarse=${COARSE:-$folder/coarse}\n"
            "for block in ${SLURM_ARRAY_TASK_ID:-$(seq 0 %zu)}; do\n"
            "    train \"$folder/block_$block\" --region \"$folder/blocks.json:$block\" --init "
            "\"$coarse\" \"$@\" || exit $?\n"
            "done\n",
            blocks - 1, settings, common, blocks - 1);
        written =
            write_script(folder, "coarse.sh", coarse) && write_script(folder, "blocks.sh", array);
        free(coarse);
        free(array);
    }
    free(common);
    free(place);
    free(data);
    return written;
}
