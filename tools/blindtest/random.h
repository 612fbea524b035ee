// Random numbers that are the same on every machine: SplitMix64 streams named by a seed and a list of keys.
// Source: Steele, Lea, Flood, "Fast splittable pseudorandom number generators", OOPSLA 2014.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <numbers>
#include <vector>

#include "core/case/geometry.h"

namespace teres::blindtest {

class Random {
  public:
    Random(std::uint64_t seed, std::initializer_list<std::uint64_t> keys) : state_(seed) {
        for (const std::uint64_t key : keys) state_ = bits() ^ (key * 0xd1342543de82ef95ULL);
    }

    std::uint64_t bits() {
        std::uint64_t z = (state_ += 0x9e3779b97f4a7c15ULL);
        z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
        z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
        return z ^ (z >> 31);
    }
    /// In [low, high).
    double uniform(double low = 0.0, double high = 1.0) {
        return low + (high - low) * static_cast<double>(bits() >> 11) * 0x1p-53;
    }
    double log_uniform(double low, double high) { return std::exp(uniform(std::log(low), std::log(high))); }
    /// In [0, count).
    std::size_t index(std::size_t count) { return static_cast<std::size_t>(bits() % count); }
    bool chance(double probability) { return uniform() < probability; }
    double sign() { return chance(0.5) ? 1.0 : -1.0; }
    double normal() {  // Box-Muller
        const double radius = std::sqrt(-2.0 * std::log(1.0 - uniform()));
        return radius * std::cos(2.0 * std::numbers::pi * uniform());
    }
    Point direction() {
        const Point p{normal(), normal(), normal()};
        return times(1.0 / norm(p), p);
    }
    template <class T>
    void shuffle(std::vector<T>& items) {
        for (std::size_t i = items.size(); i > 1; --i) std::swap(items[i - 1], items[index(i)]);
    }

  private:
    std::uint64_t state_;
};

}  // namespace teres::blindtest
