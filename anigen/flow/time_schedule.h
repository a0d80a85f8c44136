#pragma once
#include <cstdint>
#include <string>

#include "anigen/core/json.h"
#include "anigen/nn/torch.h"

namespace anigen::flow {

using torch::Tensor;

/// How training draws the flow time t of each batch item, shared by all streams of the item: 1 is noise, 0 is data
/// (reference flows-and-pipeline.md, 4.1). Config object `t_schedule`: {"name": "uniform"} or
/// {"name": "logitNormal", "args": {"mean": 1.0, "std": 1.0}}.
struct TimeSchedule {
  enum class Kind {
    kUniform,     ///< t ~ U[0, 1)
    kLogitNormal  ///< t = sigmoid(mean + deviation · z), z ~ N(0, 1)
  };
  Kind kind = Kind::kLogitNormal;
  double mean = 0.0;  ///< default of the class; the published configs say 1
  double deviation = 1.0;

  /// @param file, pointer where the object stands, for messages
  /// @throws InputError on an unknown name or key, or a standard deviation that is not positive
  static TimeSchedule from_json(const Json& json, const std::string& file = "", const std::string& pointer = "");
  Json to_json() const;

  /// @return [count] fp32 on the CPU, drawn from this generator alone
  Tensor sample(std::int64_t count, at::Generator generator) const;
  /// The times that belong to given draws: standard normal ones for logitNormal, uniform ones for uniform.
  Tensor from_draws(const Tensor& draws) const;
};

}  // namespace anigen::flow
