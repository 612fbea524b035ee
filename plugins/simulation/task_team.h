// A fixed number of threads that work on one step together. Work is split the same way every time, so results
// do not depend on which thread runs which share: same input, same bits, for a given number of threads.
#pragma once

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

namespace teres {

class TaskTeam {
  public:
    /// [setup]
    explicit TaskTeam(int threads) : TaskTeam(threads, true) {}
    /// All shares one after the other on the calling thread: same shares, same results.
    static TaskTeam on_caller(int shares) { return TaskTeam(shares, false); }

    int threads() const { return threads_; }
    /// [loop] share(rank) for every rank in [0, threads); returns when all are done.
    template <class Share>
    void run(const Share& share) {
        if (threads_ == 1 || !parallel_) {
            for (int rank = 0; rank < threads_; ++rank) share(rank);
            return;
        }
        arena_.execute([&] { tbb::parallel_for(0, threads_, share, tbb::static_partitioner{}); });
    }
    /// [loop] Splits [0, size) into one contiguous range per rank: share(rank, first, last).
    template <class Share>
    void split(std::size_t size, const Share& share) {
        run([&](int rank) {
            const auto r = static_cast<std::size_t>(rank), n = static_cast<std::size_t>(threads_);
            share(rank, size * r / n, size * (r + 1) / n);
        });
    }

  private:
    TaskTeam(int threads, bool parallel) : threads_(threads), parallel_(parallel), arena_(threads) {}

    int threads_;
    bool parallel_;
    tbb::task_arena arena_;
};

}  // namespace teres
