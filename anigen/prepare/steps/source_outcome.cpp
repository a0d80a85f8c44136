#include "anigen/prepare/steps/source_outcome.h"

namespace anigen::prepare {

Json to_json(const StepFailure& failure) {
  return {{"id", failure.id},         {"variant", failure.variant},
          {"step", failure.step},     {"fingerprint", failure.fingerprint},
          {"reason", failure.reason}, {"rule", failure.rule}};
}

StepFailure step_failure_from_json(const Json& json) {
  StepFailure failure;
  json.at("id").get_to(failure.id);
  json.at("variant").get_to(failure.variant);
  json.at("step").get_to(failure.step);
  json.at("fingerprint").get_to(failure.fingerprint);
  json.at("reason").get_to(failure.reason);
  json.at("rule").get_to(failure.rule);
  return failure;
}

Json to_json(const SourceTask& task) {
  Json known = Json::array();
  for (const StepFailure& failure : task.known) known.push_back(to_json(failure));
  return {{"number", task.number},
          {"source", to_json(task.source)},
          {"known", known},
          {"id", task.id},
          {"only_identify", task.only_identify}};
}

SourceTask source_task_from_json(const Json& json) {
  SourceTask task;
  json.at("number").get_to(task.number);
  task.source = asset_source_from_json(json.at("source"));
  json.at("id").get_to(task.id);
  json.at("only_identify").get_to(task.only_identify);
  for (const Json& failure : json.at("known")) task.known.push_back(step_failure_from_json(failure));
  return task;
}

Json to_json(const SourceOutcome& outcome) {
  Json assets = Json::array();
  for (const AssetOutcome& asset : outcome.assets) {
    Json failures = Json::array(), timings = Json::array();
    for (const StepFailure& failure : asset.failures) failures.push_back(to_json(failure));
    for (const StepTiming& timing : asset.timings) {
      timings.push_back({{"step", timing.step}, {"seconds", timing.seconds}, {"peak_bytes", timing.peak_bytes}});
    }
    assets.push_back({{"id", asset.id},
                      {"variant", asset.variant},
                      {"imported", asset.imported},
                      {"rejected_pose", asset.rejected_pose},
                      {"reused", asset.reused},
                      {"failures", failures},
                      {"timings", timings}});
  }
  return {{"number", outcome.number}, {"assets", assets}};
}

SourceOutcome source_outcome_from_json(const Json& json) {
  SourceOutcome outcome;
  json.at("number").get_to(outcome.number);
  for (const Json& one : json.at("assets")) {
    AssetOutcome asset;
    one.at("id").get_to(asset.id);
    one.at("variant").get_to(asset.variant);
    one.at("imported").get_to(asset.imported);
    one.at("rejected_pose").get_to(asset.rejected_pose);
    one.at("reused").get_to(asset.reused);
    for (const Json& failure : one.at("failures")) asset.failures.push_back(step_failure_from_json(failure));
    for (const Json& timing : one.at("timings")) {
      asset.timings.push_back({timing.at("step").get<std::string>(), timing.at("seconds").get<double>(),
                               timing.at("peak_bytes").get<std::uint64_t>()});
    }
    outcome.assets.push_back(std::move(asset));
  }
  return outcome;
}

}  // namespace anigen::prepare
