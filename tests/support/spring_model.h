// A forward model with a known solution: node i hangs on a spring theta_i beside a bed of stiffness kBed and
// is pulled by the force of region i; two markers ride on each node.
//
//     u_i = F_i / (theta_i + kBed)
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "core/extensions/forward_model.h"

namespace teres::test {

class SpringModel final : public ForwardModel {
  public:
    static constexpr double kBed = 10.0;      // N/m
    static constexpr double kMedian = 200.0;  // N/m
    static constexpr double kLogStdev = 1.0;
    static constexpr double kThreshold = 100.0;  // N/m

    explicit SpringModel(std::size_t nodes = 2) : nodes_(nodes) {
        for (std::size_t i = 0; i < nodes; ++i) {
            names_.push_back(std::string("ligament.r").append(std::to_string(i)).append(".stiffness"));
            regions_.push_back(std::string("F").append(std::to_string(i)));
        }
    }

    std::size_t num_nodes() const override { return nodes_; }
    std::size_t num_state() const override { return 3 * nodes_; }
    std::size_t num_parameters() const override { return nodes_; }
    ForwardParameter parameter(std::size_t i) const override {
        return {names_[i].c_str(), "N/m", kMedian, kLogStdev, 0.0, 0.0, std::numeric_limits<double>::infinity(),
                kThreshold};
    }
    std::size_t num_attachment_nodes() const override { return 2 * nodes_; }
    AttachmentNode attachment_node(std::size_t n) const override {
        return {static_cast<std::int32_t>(10 + n), static_cast<std::int32_t>(n / 2), n % 2 == 0 ? 0.6 : 0.9};
    }
    std::size_t num_regions() const override { return nodes_; }
    const char* region_name(std::size_t i) const override { return regions_[i].c_str(); }
    std::size_t num_tools() const override { return 0; }
    const char* tool_name(std::size_t) const override { return ""; }
    std::size_t num_markers() const override { return 2 * nodes_; }
    std::int32_t marker_id(std::size_t j) const override { return static_cast<std::int32_t>(100 + j); }
    std::size_t num_points() const override { return nodes_; }
    std::int32_t point_id(std::size_t i) const override { return static_cast<std::int32_t>(i); }
    void rest_state(std::span<double> x) const override {
        for (std::size_t i = 0; i < nodes_; ++i) {
            x[3 * i] = 0.1 * static_cast<double>(i);
            x[3 * i + 1] = x[3 * i + 2] = 0.0;
        }
    }
    ForwardReport advance(const ForwardInputs& in, std::span<const double> theta, std::span<double> X,
                          std::size_t lanes) noexcept override {
        ++calls;
        last_inputs_dt_s = in.dt_s;
        std::vector<double> rest(num_state());
        rest_state(rest);
        for (std::size_t l = 0; l < lanes; ++l)
            for (std::size_t i = 0; i < nodes_; ++i)
                for (std::size_t a = 0; a < 3; ++a)
                    X[l * num_state() + 3 * i + a] =
                        rest[3 * i + a] + in.region_force_n[3 * i + a] / (theta[l * nodes_ + i] + kBed);
        if (poison) X[0] = std::numeric_limits<double>::quiet_NaN();
        const auto count = static_cast<std::int32_t>(lanes);
        return {count, fail ? count - 1 : count, 1, 0, fail ? 1.0 : 1e-9};
    }
    void observe(std::span<const double> X, std::span<double> Z, std::size_t lanes) const noexcept override {
        for (std::size_t l = 0; l < lanes; ++l)
            for (std::size_t j = 0; j < num_markers(); ++j)
                for (std::size_t a = 0; a < 3; ++a)
                    Z[l * 3 * num_markers() + 3 * j + a] =
                        X[l * num_state() + 3 * (j / 2) + a] + (j % 2 == 1 && a == 2 ? 0.01 : 0.0);
    }
    void predict_points(std::span<const double> x, std::span<double> out) const noexcept override {
        std::copy_n(x.begin(), 3 * nodes_, out.begin());
    }

    bool fail = false;    ///< the next calls report a lane that did not converge
    bool poison = false;  ///< the next calls leave a NaN
    int calls = 0;
    double last_inputs_dt_s = -1.0;

  private:
    std::size_t nodes_;
    std::vector<std::string> names_, regions_;
};

}  // namespace teres::test
