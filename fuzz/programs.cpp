#include <arpa/inet.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>

#include "anigen/core/files.h"
#include "anigen/core/private_folder.h"
#include "anigen/engine/files.h"
#include "anigen/experiment/file.h"
#include "anigen/experiment/plan.h"
#include "anigen/studio/api.h"
#include "anigen/studio/job_runner.h"
#include "anigen/studio/job_store.h"
#include "anigen/studio/job_work.h"
#include "anigen/studio/server.h"
#include "fuzz/targets.h"
#include "tests/support/hinged_boxes.h"

namespace anigen::fuzz {

namespace {

namespace fs = std::filesystem;

// --- Requests of the studio ---

/// A studio that listens on the loopback network, with a finished rig, j000001, and a finished generation, j000002. Its
/// jobs end at once, without work. A second server of it asks for a token, "right".
class Studio {
 public:
  Studio() {
    const Asset hinge = test::hinged_boxes(0.1F, 0.3F);
    rig_ = finished("rig", "hinge.glb", engine::save_bytes(hinge));
    engine::save(hinge, store_.folder(rig_) / studio::kRiggedFile);
    generation_ = finished("generation", "picture.png", "PNG");
    write_file_atomically(store_.folder(generation_) / studio::kVoxelsFile, "NPZ");
    runner_ = std::make_unique<studio::JobRunner>(
        store_, [](const fs::path&, Job&, studio::JobRecord&) {}, 4);
    api_ = std::make_unique<studio::Api>(store_, *runner_);
    studio::ServerOptions options;
    const fs::path source = ANIGEN_SOURCE_DIR;
    options.most_bytes = std::size_t{1} << 20;
    options.page = options.three = source / "anigen/studio/page";
    options.gallery = source / "examples/creatures";
    options.openapi = source / "anigen/studio/openapi.json";
    server_ = std::make_unique<studio::Server>(*api_, options);
    options.token = "right";
    guarded_ = std::make_unique<studio::Server>(*api_, options);
  }

  /// Sends the bytes of one connection; those that speak of a token to the server that asks for one. @return the answer
  std::string answer(const std::string& bytes) const {
    const studio::Server& server = bytes.find("token") == std::string::npos ? *server_ : *guarded_;
    const int connection = ::socket(AF_INET, SOCK_STREAM, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<std::uint16_t>(server.port()));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    const timeval patience{20, 0};
    ::setsockopt(connection, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    // The port is free again at once, or thousands of connections a second use up all there are.
    const linger at_once{1, 0};
    ::setsockopt(connection, SOL_SOCKET, SO_LINGER, &at_once, sizeof at_once);
    require(::connect(connection, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0,
            "the studio takes no connection");
    for (std::size_t sent = 0; sent < bytes.size();) {
      const ssize_t taken = ::send(connection, bytes.data() + sent, bytes.size() - sent, MSG_NOSIGNAL);
      if (taken <= 0) break;  // it has refused what it saw
      sent += static_cast<std::size_t>(taken);
    }
    ::shutdown(connection, SHUT_WR);
    std::string came;
    char piece[4096];
    ssize_t got = 0;
    while ((got = ::recv(connection, piece, sizeof piece, 0)) > 0) came.append(piece, static_cast<std::size_t>(got));
    require(got == 0 || errno != EAGAIN, "the studio does not answer");
    ::close(connection);
    return came;
  }

  /// Removes the jobs that a request made, and its edit of the rig.
  void clean() {
    for (const studio::JobRecord& job : store_.list()) {
      if (job.id == rig_ || job.id == generation_) continue;
      runner_->cancel(job.id);
      while (store_.find(job.id) && !store_.remove(job.id)) ::usleep(100);
    }
    std::error_code ignored;
    fs::remove(store_.folder(rig_) / studio::kEditedFile, ignored);
    require(is_whole(), "a job is gone that nobody removed");
  }

  /// The first jobs, which a request may remove, are there.
  bool is_whole() const { return store_.find(rig_) && store_.find(generation_); }

 private:
  /// Number of a job that has ended well.
  std::string finished(const char* kind, const char* name, const std::string& bytes) {
    studio::JobRecord record;
    record.kind = kind;
    record.name = record.names["file"] = name;
    record = store_.create(record, {{"file", fs::path(name).extension(), bytes}});
    store_.update(record.id, [](studio::JobRecord& job) { job.state = studio::JobState::kDone; });
    return record.id;
  }

  PrivateFolder folder_;
  studio::JobStore store_{folder_.path()};
  std::string rig_, generation_;
  std::unique_ptr<studio::JobRunner> runner_;
  std::unique_ptr<studio::Api> api_;
  std::unique_ptr<studio::Server> server_, guarded_;
};

void answer_request(const std::string& bytes) {
  static std::unique_ptr<Studio> studio;
  if (!studio) studio = std::make_unique<Studio>();
  const std::string answer = studio->answer(bytes);
  if (!answer.empty()) {
    require(answer.rfind("HTTP/1.1 ", 0) == 0, "an answer is not HTTP");
    require(answer.compare(9, 3, "500") != 0, ("a request failed inside: " + answer).c_str());
  }
  if (studio->is_whole())
    studio->clean();
  else
    studio.reset();
}

// --- Experiments ---

/// A place for an experiment among those of the repository, so that it can extend them and name their configs.
class ExperimentPlace {
 public:
  ExperimentPlace() {
    const fs::path source = ANIGEN_SOURCE_DIR;
    for (const char* program : {"prepare", "train", "encode", "eval", "generate", "rig", "animate"})
      write_file_atomically(folder_ / "bin" / (std::string("anigen-") + program), "");
    make_folders(folder_ / "experiments/paper");
    for (const char* name : {"configs", "datasets", "experiments/configs", "experiments/datasets"})
      fs::create_directory_symlink(source / fs::path(name).filename(), folder_ / name);
    fs::create_directory_symlink(source / "experiments/paper/scales", folder_ / "experiments/paper/scales");
    for (const char* from : {"experiments", "experiments/paper"}) {
      for (const fs::directory_entry& entry : fs::directory_iterator(source / from)) {
        if (entry.path().extension() != ".json") continue;
        for (const char* to : {"experiments", "experiments/paper"})
          fs::create_symlink(entry.path(), folder_ / to / entry.path().filename());
      }
    }
  }

  void plan(const std::string& bytes) const {
    const fs::path file = folder_ / "experiments/paper/input.json";
    std::ofstream(file, std::ios::binary) << bytes;
    if (experiment::read_collection(file)) return;
    for (const char* scale : {"", "tiny"}) {
      const experiment::Experiment read = experiment::read_experiment(file, {}, scale);
      for (const experiment::Job& job : experiment::make_plan(read, {folder_ / "out", folder_ / "bin", "cpu"}).jobs)
        experiment::shell_line(job.command);
      for (const auto& [name, step] : read.steps.items()) {
        for (const experiment::Variant& variant : read.variants)
          experiment::sbatch_lines(experiment::read_step(read, variant, name).resources);
      }
    }
  }

 private:
  PrivateFolder folder_;
};

/// Reads and plans an experiment beside programs that are there and never called.
void plan_experiment(const std::string& bytes) {
  static const ExperimentPlace place;
  place.plan(bytes);
}

}  // namespace

std::map<std::string, Target> program_targets() { return {{"http", answer_request}, {"experiment", plan_experiment}}; }

}  // namespace anigen::fuzz
