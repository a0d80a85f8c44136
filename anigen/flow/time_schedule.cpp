#include "anigen/flow/time_schedule.h"

#include "anigen/core/config_reader.h"

namespace anigen::flow {

TimeSchedule TimeSchedule::from_json(const Json& json, const std::string& file, const std::string& pointer) {
  ConfigReader reader(json, file, pointer);
  TimeSchedule schedule;
  const std::string name = reader.choice("name", "logitNormal", {"uniform", "logitNormal"});
  schedule.kind = name == "uniform" ? Kind::kUniform : Kind::kLogitNormal;
  ConfigReader args = reader.object("args");
  if (schedule.kind == Kind::kLogitNormal) {
    schedule.mean = args.number("mean", schedule.mean);
    schedule.deviation = args.number("std", schedule.deviation);
    if (schedule.deviation <= 0.0) throw args.error("std", "must be positive");
  }
  args.finish();
  reader.finish();
  return schedule;
}

Json TimeSchedule::to_json() const {
  Json json;
  json["name"] = kind == Kind::kUniform ? "uniform" : "logitNormal";
  if (kind == Kind::kLogitNormal) json["args"] = {{"mean", mean}, {"std", deviation}};
  return json;
}

Tensor TimeSchedule::sample(std::int64_t count, at::Generator generator) const {
  return from_draws(kind == Kind::kUniform ? torch::rand({count}, generator) : torch::randn({count}, generator));
}

Tensor TimeSchedule::from_draws(const Tensor& draws) const {
  return kind == Kind::kUniform ? draws : torch::sigmoid(draws * deviation + mean);
}

}  // namespace anigen::flow
