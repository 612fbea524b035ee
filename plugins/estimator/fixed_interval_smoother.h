// Fixed-interval (Rauch-Tung-Striebel) smoothing of parameters that walk at random: what the whole recording
// says about each frame. Offline only. With F = 1, m_k, P_k after frame k and P-_k before its correction
// (process noise included):
//
//     G_k = P_k (P-_{k+1})^-1       m^s_k = m_k + G_k (m^s_{k+1} - m_k)       P^s_k = P_k + G_k (P^s_{k+1} -
//     P-_{k+1}) G_k^T
#pragma once

#include <Eigen/Dense>
#include <vector>

namespace teres {

struct FilteredFrame {
    Eigen::VectorXd mean;                  ///< filter coordinates, after the correction
    Eigen::MatrixXd covariance;            ///< after the correction
    Eigen::MatrixXd predicted_covariance;  ///< before the correction
};

struct SmoothedFrame {
    Eigen::VectorXd mean;
    Eigen::MatrixXd covariance;
};

/// One smoothed frame per filtered frame, in time order.
std::vector<SmoothedFrame> smooth(const std::vector<FilteredFrame>& frames);

}  // namespace teres
