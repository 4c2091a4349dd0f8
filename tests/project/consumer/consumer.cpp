// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Uses the installed library from C++.

#include <cstdio>
#include <memory>

#include <sparegs/gaussians.h>
#include <sparegs/runtime.h>
#include <sparegs/trainer.h>

int main()
{
    sgs_gaussians *created = nullptr;
    if (sgs_gaussians_create(100, &created))
        return 1;
    const std::unique_ptr<sgs_gaussians, void (*)(sgs_gaussians *)> model(created,
                                                                          sgs_gaussians_destroy);
    const sgs_train_options options = sgs_train_options_default();
    std::printf("sparegs %s from C++: room for %zu, %d iterations\n", sgs_version(),
                model->capacity, options.iterations);
    return model->capacity >= 100 && options.iterations == 30000 ? 0 : 1;
}
