// Runs f(i, thread) for i in [0, count) on a fixed number of threads; index i always on thread i % threads,
// so results do not depend on timing.
#pragma once

#include <cstddef>
#include <thread>
#include <vector>

namespace teres::peer {

template <class F>
void parallel_for(std::size_t count, std::size_t threads, const F& f) {
    const auto work = [&](std::size_t thread) {
        for (std::size_t i = thread; i < count; i += threads) f(i, thread);
    };
    std::vector<std::jthread> others;
    for (std::size_t t = 1; t < threads; ++t) others.emplace_back(work, t);
    work(0);
}

}  // namespace teres::peer
