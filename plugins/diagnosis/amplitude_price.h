// What the parameters of an effect cost its evidence: how far they are from what is expected, and how narrowly the data
// had to fit them.
#pragma once

#include <Eigen/Dense>
#include <vector>

namespace teres {

/// Student-t price of amplitudes `a` in prior standard deviations [nats]: far amplitudes are unlikely, not impossible.
double tail_price(const Eigen::VectorXd& a);

/// Amplitudes of one effect are not independent a priori (an organ breathes in one direction with one wave form): at
/// most seven count, one more than a rigid offset has, so that a registration is not taken for a support that stands
/// elsewhere.
Eigen::Index counted_amplitudes(Eigen::Index amplitudes);
/// 1/2 ln|I + S| over the `counted` largest directions [nats]; S: tempered chi^2 of amplitudes at one prior standard
/// deviation.
double occam_price(const Eigen::MatrixXd& S, Eigen::Index counted);
/// What the amplitudes of effects cost. How large an effect is, is not known to a factor: those of effect e share a
/// scale s_e, 1 with 70 % and 1/2, 1/4, 1/8 with 10 % each,
///
///     price = -ln sum over all s of p(s) exp(-sum_e tail(a_e/s_e) - 1/2 ln|I + D S D|)     D: s_e on its amplitudes
///
/// `tail` is that of the most probable scales, `occam` the rest. `a`: per effect, in prior standard deviations; S as in
/// occam_price(), in their order.
struct AmplitudePrice {
    double tail = 0.0, occam = 0.0;  ///< [nats]
};
AmplitudePrice amplitude_price(const std::vector<Eigen::VectorXd>& a, const Eigen::MatrixXd& S, Eigen::Index counted);
/// What 1/2 ln|I + S| grows by when places and times (rows behind the `amplitudes` first) count as well [nats].
double narrowing_price(const Eigen::MatrixXd& S, Eigen::Index amplitudes);

}  // namespace teres
