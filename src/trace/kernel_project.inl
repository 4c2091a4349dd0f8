// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Projection: parameters -> projected records, dilated bounds for the BVH, and 3DGS's visibility
// statistics (projected radius: 3 standard deviations of the covariance of Kerbl et al. 2023,
// equation 5).

// Mask of the lanes that can be traced: no parameter is NaN or infinite (x * 0 is then not 0), and
// the mean is within the range of single precision. A box that is not finite would corrupt whole
// subtrees at the next refit.
static inline vm sane_shapes(const float *p, const gaussian16 *g)
{
    vf zeros = vf_zero();
    for (int k = SGS_PARAM_MEAN; k <= SGS_PARAM_OPACITY; ++k)
        zeros = vf_fma(vf_load(p + 16 * k), vf_zero(), zeros);
    return vm_and(vf_ge(zeros, vf_zero()), vf_lt(g->distance, vf_set1(1e15f)));
}

// Embree ignores boxes that extend beyond 1.8e18.
static inline vf within_embree(vf x)
{
    return vf_clamp(x, vf_set1(-1e18f), vf_set1(1e18f));
}

// Writes 16 bounds; `half`: half extents along the world axes.
static inline void store_bounds(sgsi_bounds *bounds, vec3 mean, vec3 half)
{
    vf rows[16];
    rows[0] = within_embree(vf_sub(mean.x, half.x)),
    rows[4] = within_embree(vf_add(mean.x, half.x));
    rows[1] = within_embree(vf_sub(mean.y, half.y)),
    rows[5] = within_embree(vf_add(mean.y, half.y));
    rows[2] = within_embree(vf_sub(mean.z, half.z)),
    rows[6] = within_embree(vf_add(mean.z, half.z));
    rows[3] = rows[7] = vf_zero();
    for (int k = 8; k < 16; ++k)
        rows[k] = vf_zero();
    vf_transpose16(rows);
    for (int i = 0; i < 16; ++i) {
        float row[16] __attribute__((aligned(64)));
        vf_store(row, rows[i]);
        memcpy(&bounds[i], row, sizeof bounds[i]);
    }
}

static inline void project_bounds(const sgsi_project *input, size_t block, const gaussian16 *g,
                                  vf reach, vm sane, vm traced)
{
    const sgsi_view *view = &input->view;
    const float *p = input->params + block * SGS_PARAM_COUNT * 16;
    const vec3 mean = {vf_load(p), vf_load(p + 16), vf_load(p + 32)};
    const vec3 e0 = scale3(g->axis[0], g->filtered.x), e1 = scale3(g->axis[1], g->filtered.y);
    const vec3 e2 = scale3(g->axis[2], g->filtered.z);
    const vec3 w0 = rotate3_back(view->rotation, e0), w1 = rotate3_back(view->rotation, e1);
    const vec3 w2 = rotate3_back(view->rotation, e2);
    const vf longest = vf_max(g->filtered.x, vf_max(g->filtered.y, g->filtered.z));
    // A cone ray deviates from its axis by at most its distance times the tangent. The rest of the
    // padding covers rounding: of the box tests (relative to the distance) and of the coordinates.
    const vf magnitude =
        vf_add(vf_max(vf_abs(mean.x), vf_max(vf_abs(mean.y), vf_abs(mean.z))), g->distance);
    const vf pad =
        vf_fma(vf_fma(reach, longest, g->distance), vf_set1(view->rays->tan_cone * 1.001f),
               vf_mul(magnitude, vf_set1(4e-6f)));
    const vf wide = vf_mul(reach, vf_set1(1.0005f));
    vec3 half = {
        vf_fma(wide, vf_sqrt(vf_fma(w0.x, w0.x, vf_fma(w1.x, w1.x, vf_mul(w2.x, w2.x)))), pad),
        vf_fma(wide, vf_sqrt(vf_fma(w0.y, w0.y, vf_fma(w1.y, w1.y, vf_mul(w2.y, w2.y)))), pad),
        vf_fma(wide, vf_sqrt(vf_fma(w0.z, w0.z, vf_fma(w1.z, w1.z, vf_mul(w2.z, w2.z)))), pad)};
    half = (vec3){vf_keep(traced, half.x), vf_keep(traced, half.y), vf_keep(traced, half.z)};
    const vec3 place = {vf_keep(sane, mean.x), vf_keep(sane, mean.y), vf_keep(sane, mean.z)};
    store_bounds(input->bounds + 16 * block, place, half);
}

// Mask of the primitives with a possible hit beyond the near distance. On a ray, the hit is at the
// largest response, where (M x).(M x - M delta) = 0: on the sphere over the diameter from the
// camera to the mean, in the metric of M, and within the support. Hence
//     |x - delta / 2| <= longest P / 2,    |x - delta| <= longest reach.
static inline vm hits_beyond_near(const sgsi_view *view, const gaussian16 *g, vf longest, vf reach)
{
    const vf over_diameter = vf_mul(vf_set1(0.5f), vf_fma(longest, g->p, g->distance));
    const vf farthest = vf_min(over_diameter, vf_fma(longest, reach, g->distance));
    return vf_gt(vf_mul(farthest, vf_set1(1.0005f)), vf_set1(view->near_distance));
}

// Projected radius of 3DGS: 3 sqrt(lambda_max) of the projected covariance + 0.3 px^2 (0.1 with the
// mip filter), rounded up; 0 if not visible. As in 3DGS, perspective lenses do not see a centre
// nearer than the near distance. Fisheye lenses have no such limit: there, a primitive is visible
// if it may have a hit, and its radius is measured at the near distance or farther.
static inline vf projected_radius(const sgsi_view *view, const gaussian16 *g, vm in_cone,
                                  vf longest_filtered, vf reach)
{
    const sgsi_rays *rays = view->rays;
    const vf zero = vf_zero(), one = vf_set1(1.0f), pixel = vf_set1(view->mip ? 0.1f : 0.3f);
    const vf largest = vf_set1(1e12f); // variance, px^2
    if (rays->fisheye) {
        const vf longest = vf_max(g->body.x, vf_max(g->body.y, g->body.z));
        const vf distance = vf_max(g->distance, vf_set1(view->near_distance));
        const vf sigma = vf_div(vf_mul(longest, vf_set1(rays->focal)), distance);
        const vf variance = vf_min(vf_fma(sigma, sigma, pixel), largest);
        const vf radius = vf_add(vf_mul(vf_set1(3.0f), vf_sqrt(variance)), vf_set1(0.5f));
        return vf_keep(vm_and(in_cone, hits_beyond_near(view, g, longest_filtered, reach)), radius);
    }
    const float width = (float)rays->camera.width, height = (float)rays->camera.height;
    const vf z = g->delta.z;
    vm visible = vf_gt(z, vf_set1(view->near_distance));
    if (!vm_any(visible))
        return zero;
    const vf inv_z = vf_div(one, vf_select(visible, z, one));
    const vf limit_x = vf_set1(1.3f * 0.5f * width / rays->fx),
             limit_y = vf_set1(1.3f * 0.5f * height / rays->fy);
    const vf x = vf_mul(g->delta.x, inv_z), y = vf_mul(g->delta.y, inv_z);
    const vf tx = vf_clamp(x, vf_sub(zero, limit_x), limit_x),
             ty = vf_clamp(y, vf_sub(zero, limit_y), limit_y);
    const vf jx = vf_mul(vf_set1(rays->fx), inv_z), jy = vf_mul(vf_set1(rays->fy), inv_z);
    vf xx = pixel, xy = zero, yy = pixel;
    const vf s[3] = {g->body.x, g->body.y, g->body.z};
    for (int k = 0; k < 3; ++k) {
        const vf u = vf_mul(vf_mul(jx, s[k]), vf_fnma(tx, g->axis[k].z, g->axis[k].x));
        const vf v = vf_mul(vf_mul(jy, s[k]), vf_fnma(ty, g->axis[k].z, g->axis[k].y));
        xx = vf_fma(u, u, xx), xy = vf_fma(u, v, xy), yy = vf_fma(v, v, yy);
    }
    const vf middle = vf_mul(vf_set1(0.5f), vf_add(xx, yy));
    const vf det = vf_fms(xx, yy, vf_mul(xy, xy));
    const vf lambda = vf_add(middle, vf_sqrt(vf_max(vf_set1(0.1f), vf_fms(middle, middle, det))));
    const vf exact = vf_mul(vf_set1(3.0f), vf_sqrt(vf_min(lambda, largest)));
    vf radius = vi_to_vf(vf_to_vi(exact));
    radius = vf_select(vf_lt(radius, exact), vf_add(radius, one), radius); // ceil
    // The square around the centre must overlap a 16x16 tile of the image. Pixel centres are
    // integers here.
    const vf u = vf_fma(vf_set1(rays->fx), x, vf_set1(rays->cx - 0.5f)),
             v = vf_fma(vf_set1(rays->fy), y, vf_set1(rays->cy - 0.5f));
    visible = vm_and(visible, vm_and(vf_ge(vf_add(u, radius), one), vf_ge(vf_add(v, radius), one)));
    visible =
        vm_and(visible, vm_and(vf_lt(vf_sub(u, radius), vf_set1(16.0f * (float)rays->tiles_x)),
                               vf_lt(vf_sub(v, radius), vf_set1(16.0f * (float)rays->tiles_y))));
    return vf_keep(visible, radius);
}

static inline void project_statistics(const sgsi_project *input, size_t block, const gaussian16 *g,
                                      vm in_cone, vf longest_filtered, vf reach)
{
    const vf radius = projected_radius(&input->view, g, in_cone, longest_filtered, reach);
    const vm visible = vm_and(in_cone, vf_gt(radius, vf_zero()));
    if (input->visible)
        input->visible[block] = (uint16_t)vm_bits(visible);
    if (!input->visible_count)
        return;
    float *largest = input->radius_max + 16 * block;
    vf_store(largest, vf_max(vf_load(largest), vf_keep(visible, radius)));
    int32_t *count = (int32_t *)input->visible_count + 16 * block;
    vi_store(count, vi_add(vi_load(count), vf_as_vi(vf_keep(visible, vi_as_vf(vi_set1(1))))));
}

static inline void store_projected(const sgsi_project *input, size_t block, const gaussian16 *g,
                                   vf log_opacity, vf radius, vm traced)
{
    const float *p = input->params + block * SGS_PARAM_COUNT * 16;
    const vf one = vf_set1(1.0f);
    const vf kappa = vf_mul(vf_mul(g->p, g->p), vf_set1(SGSI_HALF_LOG2E));
    const vf unit = vf_div(g->distance, g->p);
    const vf root = vf_mul(unit, vf_sqrt(kappa));
    const vec3 a = frame_row(g, g->q1, root), b = frame_row(g, g->q2, root),
               c = frame_row(g, g->q3, unit);
    const vec3 direction = scale3(g->delta_world, vf_div(one, g->distance));
    vf color[3];
    sh_colors(p, direction, input->view.sh_degree, color);
    // Finite, because 0 * infinity would corrupt pixels that miss the primitive.
    const vf brightest = vf_set1(1e9f);
    vf rows[16] = {a.x,
                   a.y,
                   a.z,
                   b.x,
                   b.y,
                   b.z,
                   c.x,
                   c.y,
                   c.z,
                   vf_select(traced, log_opacity, vf_set1(SGSI_UNTRACED)),
                   vf_div(one, kappa),
                   g->distance,
                   vf_clamp(color[0], vf_zero(), brightest),
                   vf_clamp(color[1], vf_zero(), brightest),
                   vf_clamp(color[2], vf_zero(), brightest),
                   radius};
    vf_transpose16(rows);
    for (int i = 0; i < 16; ++i)
        vf_store(input->projected + (16 * block + (size_t)i) * SGSI_PROJECTED_FLOATS, rows[i]);
}

static void project(const sgsi_project *input, size_t begin, size_t end)
{
    const sgsi_rays *rays = input->view.rays;
    for (size_t block = begin; block < end; ++block) {
        gaussian16 g;
        load_gaussian(input->params + block * SGS_PARAM_COUNT * 16, block, &input->view, &g);
        const size_t left = input->count - 16 * block;
        const vm present = vm_from_bits(left >= 16 ? 0xFFFFu : (1u << left) - 1u);
        const vf longest = vf_max(g.filtered.x, vf_max(g.filtered.y, g.filtered.z));
        // Support radius k = sqrt(2 ln(255 o)) = sqrt(log2(255 o) / (log2(e) / 2)).
        const vf log_opacity = vf_log2(g.opacity);
        const vf level = vf_add(log_opacity, vf_set1(SGSI_LOG2_255));
        const vm opaque = vf_ge(level, vf_zero());
        const vf reach = vf_sqrt(vf_mul(vf_max(level, vf_zero()), vf_set1(1.0f / SGSI_HALF_LOG2E)));
        // Distance from the surface of the cone that encloses the image; negative inside.
        const vec3 axis = {vf_set1(rays->axis[0]), vf_set1(rays->axis[1]), vf_set1(rays->axis[2])};
        const vf along = dot3(axis, g.delta);
        const vf across =
            vf_sqrt(vf_max(vf_zero(), vf_fms(g.distance, g.distance, vf_mul(along, along))));
        const vf outside =
            vf_fms(across, vf_set1(rays->cone_cos), vf_mul(along, vf_set1(rays->cone_sin)));
        const vf margin = vf_fma(reach, longest, vf_mul(g.distance, vf_set1(1e-4f)));
        const vm sane = sane_shapes(input->params + block * SGS_PARAM_COUNT * 16, &g);
        const vm in_cone = vm_and(vm_and(present, sane), vf_le(outside, margin));
        const vm traced = vm_and(in_cone, opaque);
        project_bounds(input, block, &g, reach, sane, traced);
        if (input->visible_count || input->visible)
            project_statistics(input, block, &g, in_cone, longest, reach);
        if (vm_any(traced))
            store_projected(input, block, &g, log_opacity, vf_mul(reach, longest), traced);
        else
            for (int i = 0; i < 16; ++i)
                input->projected[(16 * block + (size_t)i) * SGSI_PROJECTED_FLOATS +
                                 SGSI_PROJECTED_LOG_OPACITY] = SGSI_UNTRACED;
    }
}
