// CalculiX in tests.
#pragma once

#include <gtest/gtest.h>

#include "tools/calculix/static_problem.h"

namespace teres::test {
using namespace teres::calculix;  // NOLINT(google-build-using-namespace)
}  // namespace teres::test

/// Skips loudly when ccx is not installed.
#define TERES_REQUIRE_CALCULIX()                \
    if (!teres::calculix::calculix_available()) \
    GTEST_SKIP() << "SKIPPED LOUDLY: program 'ccx' not found; apt-get install calculix-ccx"
