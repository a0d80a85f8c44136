#pragma once
#include <Eigen/Core>
#include <string>
#include <vector>

namespace anigen::eval {

/// Anymate's joint metrics (reference anymate-baselines.md, 6.1). Distances and the threshold are in its frame: the
/// object in [-1, 1]³, longest side 2, so coordinates of the unit box must be doubled first.
inline constexpr double kAnymateJointThreshold = 0.1;

/// What their `earth_movers_distance` returns: not the exact transport cost but that of a log-domain Sinkhorn plan at
/// regularisation 1e-4 after at most 100 iterations, which is seldom converged (see exact transport for the true one).
struct ReleasedEmd {
  double cost = 0;       ///< Σ plan · distance
  double plan_mass = 0;  ///< Σ plan: 1 when converged; only the true joints' masses are right by construction
  int iterations = 0;
};

struct AnymateJointScore {
  std::string not_computed;  ///< the reason, or empty; the numbers below then are 0 and must not be averaged
  double cd = 0;             ///< ½ (mean nearest distance predicted → true + true → predicted)
  ReleasedEmd emd;
  double precision = 0;  ///< share of predicted joints strictly nearer than the threshold to some true joint
  double recall = 0;     ///< share of true joints strictly nearer than the threshold to some predicted joint
};

/// As published, fewer than 2 predicted joints are left out: not_computed says so.
/// @param predicted, truth finite @throws InputError without true joints
AnymateJointScore anymate_joint(const std::vector<Eigen::Vector3d>& predicted,
                                const std::vector<Eigen::Vector3d>& truth, double threshold = kAnymateJointThreshold);

/// The iteration exactly: masses 1/n and 1/m, potentials u = v = 0, cost M of Euclidean distances, ε = 1e-4;
/// u_i ← ε (ln 1/n − LSE_j((v_j − M_ij)/ε)), then v_j likewise; stops after 100, or when both Σ|Δu| and Σ|Δv| are below
/// 1e-3. @param predicted, truth at least one joint each
ReleasedEmd anymate_emd(const std::vector<Eigen::Vector3d>& predicted, const std::vector<Eigen::Vector3d>& truth);

}  // namespace anigen::eval
