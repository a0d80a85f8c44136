#include "anigen/prepare/run/worker_main.h"

#include <unistd.h>

#include <cerrno>
#include <iostream>
#include <memory>
#include <string>

#include "anigen/core/error.h"
#include "anigen/core/log.h"
#include "anigen/core/parallel.h"
#include "anigen/core/progress.h"
#include "anigen/prepare/steps/prepare_source.h"

namespace anigen::prepare {
namespace {

/// Writes messages to what was standard output, which now is standard error for everybody else.
class Messages {
 public:
  Messages() : descriptor_(::dup(STDOUT_FILENO)) { ::dup2(STDERR_FILENO, STDOUT_FILENO); }
  ~Messages() { ::close(descriptor_); }

  void send(const Json& message) const {
    const std::string text = message.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n";
    std::size_t sent = 0;
    while (sent < text.size()) {
      const ssize_t n = ::write(descriptor_, text.data() + sent, text.size() - sent);
      if (n >= 0) {
        sent += static_cast<std::size_t>(n);
      } else if (errno != EINTR) {
        std::_Exit(1);  // nobody listens any more
      }
    }
  }

 private:
  int descriptor_;
};

void work(const FeatureExtractorFactory& factory, const Messages& messages) {
  std::string line;
  if (!std::getline(std::cin, line)) return;
  const WorkerSettings settings = worker_settings_from_json(parse_json(line, "settings of a worker"));
  log::setup(settings.log_level);
  Progress::set_quiet(true);
  set_thread_count(settings.threads);
  const SourcePreparer preparer(settings.out, settings.plan, make_extractor(settings.plan, factory));
  messages.send({{"event", "ready"}});
  const auto observe = [&](const StepBegin& at) {
    messages.send({{"event", "step"},
                   {"asset", at.id},
                   {"variant", at.variant},
                   {"step", at.step},
                   {"fingerprint", at.fingerprint}});
  };
  while (std::getline(std::cin, line)) {
    const SourceTask task = source_task_from_json(parse_json(line, "task of a worker"));
    messages.send({{"event", "done"}, {"result", to_json(preparer.prepare(task, observe))}});
  }
}

}  // namespace

Json to_json(const WorkerSettings& settings) {
  return {{"out", settings.out.string()},
          {"plan", to_json(settings.plan)},
          {"threads", settings.threads},
          {"log_level", settings.log_level}};
}

WorkerSettings worker_settings_from_json(const Json& json) {
  WorkerSettings settings;
  settings.out = json.at("out").get<std::string>();
  settings.plan = step_plan_from_json(json.at("plan"));
  json.at("threads").get_to(settings.threads);
  json.at("log_level").get_to(settings.log_level);
  return settings;
}

int run_worker(const FeatureExtractorFactory& factory) {
  const Messages messages;
  try {
    work(factory, messages);
    return 0;
  } catch (const std::exception& error) {
    const bool bad_input = dynamic_cast<const InputError*>(&error) != nullptr;
    messages.send({{"event", "fatal"}, {"message", error.what()}, {"bad_input", bad_input}});
    return bad_input ? 2 : 1;
  }
}

}  // namespace anigen::prepare
