// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Renders views of a scene on several ranks from a model that is divided among them: no rank holds
// all primitives. Every image has the same bits as that of sgs_renderer_render. With one rank, or
// if the model fits into the memory of each rank, use sgs_renderer on different views instead,
// which needs no communication.
//
// Threads: calls are collective calls on `ranks`: no other call on that object may run at the same
// time.

#include "sparegs/ranks.h"
#include "sparegs/render.h"
#include "sparegs/scene.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct sgs_rank_renderer sgs_rank_renderer;

// Divides the primitives of a model file, as sgs_ply_read reads it, among two or more ranks. Rank 0
// reads the file in parts; other ranks ignore `path`. The scene must outlive the renderer; its
// photos are not used. options NULL = the defaults with the near distance of the scene,
// sgs_near_distance(scene->extent), as in training; filter_3d, progress and differentiable are
// ignored. Fails as sgs_ply_read, with OUT_OF_MEMORY, INVALID_ARGUMENT (options, one rank) or
// UNSUPPORTED (Embree); *renderer is then NULL. Collective.
SGS_API sgs_status sgs_rank_renderer_create(sgs_ranks *ranks, const sgs_scene *scene,
                                            const char *path, const sgs_render_options *options,
                                            sgs_rank_renderer **renderer);
SGS_API void sgs_rank_renderer_destroy(sgs_rank_renderer *renderer); // accepts NULL

// Renders a view (index into scene->views) into the colour and transmittance of the frame of rank
// `receiver`, whose size must be the camera's; other ranks ignore `frame`. own: the status of this
// rank so far. Fails with INVALID_ARGUMENT if the scene has no such view, as sgs_renderer_render,
// or as another rank does. Collective.
SGS_API sgs_status sgs_rank_renderer_render(sgs_rank_renderer *renderer, sgs_status own,
                                            size_t view, int receiver, sgs_frame *frame);

#ifdef __cplusplus
}
#endif
