#pragma once
#include <string>

#include "anigen/generate/anymate_rigger.h"
#include "anigen/io/rigs/rigged_shape.h"
#include "tests/anymate/anymate_small.h"

namespace anigen::generate {

/// A closed bar along x, four by a half by a half, with a chain of three joints.
inline io::RiggedShape bar(double scale = 1.0) {
  io::RiggedShape shape;
  shape.id = "bar";
  shape.file = "bar.glb";
  for (int corner = 0; corner < 8; ++corner) {
    const Eigen::Vector3d place(corner & 1 ? 4.0 : 0.0, corner & 2 ? 0.5 : 0.0, corner & 4 ? 0.5 : 0.0);
    shape.mesh.vertices.emplace_back((scale * place).cast<float>());
  }
  shape.mesh.faces = {{0, 2, 3}, {0, 3, 1}, {4, 5, 7}, {4, 7, 6}, {0, 1, 5}, {0, 5, 4},
                      {2, 6, 7}, {2, 7, 3}, {0, 4, 6}, {0, 6, 2}, {1, 3, 7}, {1, 7, 5}};
  for (const double x : {0.5, 2.0, 3.5}) shape.joints.positions.emplace_back(scale * Eigen::Vector3d(x, 0.25, 0.25));
  shape.joints.parents = {-1, 0, 1};
  shape.joint_names = {"hip", "knee", "foot"};
  return shape;
}

/// A small model with random weights, the same for the same names.
inline TrainedAnymateModel small_trained(const std::string& encoder, const std::string& decoder) {
  torch::manual_seed(11);
  TrainedAnymateModel trained;
  trained.model = anymate::AnymateModel(anymate::small_model(encoder, decoder));
  trained.model->eval();
  trained.file = encoder + "-" + decoder;
  trained.points = 64;
  trained.train_steps = 4;
  trained.denoised_joints = 12;
  return trained;
}

}  // namespace anigen::generate
