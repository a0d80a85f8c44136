#include <chrono>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <string>
#include <system_error>
#include <thread>

#include "anigen/apps/common/command_line.h"
#include "anigen/core/files.h"
#include "anigen/core/log.h"
#include "anigen/core/private_folder.h"
#include "anigen/core/process.h"
#include "anigen/core/sandbox.h"
#include "anigen/studio/access.h"
#include "anigen/studio/job_process.h"
#include "anigen/studio/server.h"

namespace {

using namespace anigen;
namespace fs = std::filesystem;

constexpr const char* kWorkerWord = "--worker";  // this program as a process that does jobs; a folder follows

struct StudioArguments {
  fs::path output = "studio", first_job;
  double job_gigabytes = 8.0;
  int job_minutes = 30;
  studio::ServerOptions server;
};

/// Sends the image that a first start shows as a creature. @return the job's id, empty where there is none
std::string submit_first_image(studio::Api& api, const fs::path& gallery) {
#ifdef ANIGEN_WITH_TORCH
  const fs::path image = gallery / "deer.png";
  std::error_code ignored;
  if (gallery.empty() || !fs::exists(image, ignored)) return "";
  const studio::Reply reply = api.submit("generation", {{"file", {"deer.png", read_file(image)}}});
  return Json::parse(reply.body).at("id").get<std::string>();
#else
  static_cast<void>(api), static_cast<void>(gallery);
  return "";
#endif
}

void warn_of_missing_means() {
  const SandboxMeans means = sandbox_means();
  if (!means.calls)
    anigen::log::warn("this system has no seccomp filters: processes of jobs may open sockets and run programs");
  if (!means.folders)
    anigen::log::warn("this system has no Landlock: processes of jobs may change files outside the folder of the jobs");
}

/// The first start shows a creature: the one that was made when the studio was installed, else an example image becomes
/// one while the page opens.
void welcome(studio::JobStore& store, studio::Api& api, const studio::ServerOptions& options) {
  if (!store.list().empty()) return;
  std::error_code ignored;
  const fs::path made = options.page / "first_job";
  if (!options.page.empty() && fs::exists(made, ignored)) {
    try {
      store.adopt(made);
      return;
    } catch (const Error& error) {
      anigen::log::warn("{}", error.what());
    }
  }
  submit_first_image(api, options.gallery);
}

studio::JobProcessOptions process_options(const StudioArguments& arguments, const CommonOptions& common) {
  studio::JobProcessOptions limits;
  limits.command = {fs::read_symlink("/proc/self/exe").string(), kWorkerWord};
  limits.threads = common.threads;
  limits.memory_bytes = static_cast<std::uint64_t>(arguments.job_gigabytes * (1 << 30));
  limits.minutes = arguments.job_minutes;
  return limits;
}

/// Makes the job that a first start shows, in a store of its own, and moves it to a folder.
void make_first_job(const StudioArguments& arguments, const CommonOptions& common) {
  std::error_code error;
  if (fs::exists(arguments.first_job, error))
    throw InputError(arguments.first_job.string(), "--first-job", "is there already");
  const PrivateFolder work;
  studio::JobStore store(work.path());
  studio::JobProcesses processes(process_options(arguments, common));
  studio::JobRunner runner(
      store, [&](const fs::path& folder, Job& job, studio::JobRecord& record) { processes.run(folder, job, record); });
  studio::Api api(store, runner);
  const fs::path page = studio::find_page(fs::read_symlink("/proc/self/exe"));
  const std::string id = submit_first_image(api, studio::find_gallery(page));
  if (id.empty()) throw NotSupportedError("", "--first-job", "no example image is there, or no LibTorch to use it");
  while (!has_ended(store.find(id)->state)) {
    throw_if_interrupted();
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  runner.stop();
  const studio::JobRecord made = store.find(id).value();
  if (made.state != studio::JobState::kDone) throw Error("the example image: " + made.error);
  make_folders(arguments.first_job.parent_path());
  fs::copy(store.folder(id), arguments.first_job, error);
  if (error) throw WriteError("cannot write " + arguments.first_job.string() + ": " + error.message());
}

void serve(StudioArguments arguments, const CommonOptions& common) {
  studio::JobStore store(arguments.output);
  studio::JobProcesses work(process_options(arguments, common));
  studio::JobRunner runner(
      store, [&work](const fs::path& folder, Job& job, studio::JobRecord& record) { work.run(folder, job, record); });
  studio::Api api(store, runner);
  std::error_code ignored;
  studio::ServerOptions& options = arguments.server;
  options.job_gigabytes = arguments.job_gigabytes;
  options.job_minutes = arguments.job_minutes;
  options.page = studio::find_page(fs::read_symlink("/proc/self/exe", ignored));
  options.three = studio::find_three(options.page);
  options.validator = studio::find_validator(options.page);
  options.openapi = studio::find_openapi(options.page);
  options.gallery = studio::find_gallery(options.page);
  if (options.page.empty()) anigen::log::warn("the folder of the page was not found; the HTTP routes work without it");
  if (!options.page.empty() && options.three.empty())
    anigen::log::warn("three.js was not found, so the page shows no 3D view: npm install three, or set NODE_PATH");
  warn_of_missing_means();
  if (!studio::is_loopback(options.host)) options.token = studio::new_token();
  studio::Server server(api, options);
  welcome(store, api, options);
  print_result({{"address", server.address()}, {"output", arguments.output.string()}}, server.address() + "\n", common);
  std::fflush(stdout);
  while (!interrupt_requested()) std::this_thread::sleep_for(std::chrono::milliseconds(100));
  server.stop();
  runner.stop();
}

}  // namespace

int main(int argc, char** argv) {
  if (argc == 3 && std::strcmp(argv[1], kWorkerWord) == 0) return studio::run_job_worker(argv[2]);
  Program program("anigen-studio",
                  "Serves a page on this machine that makes, corrects, compares and downloads rigs, and prints its\n"
                  "address. Jobs are kept in a folder; Ctrl-C stops, and what was not done goes on at the next start.",
                  "  anigen-studio\n"
                  "  anigen-studio --output ~/rigs --port 8080");
  StudioArguments arguments;
  add_option(program.app, "--output", arguments.output, ": folder of the jobs")->default_str("studio");
  add_option(program.app, "--port", arguments.server.port, " [any that is free]")
      ->check(whole_number(1, 65535))
      ->default_str("");
  add_option(program.app, "--job-memory", arguments.job_gigabytes)->check(number(0, 1e6, RangeEnds::kOpenBelow));
  add_option(program.app, "--job-minutes", arguments.job_minutes)->check(whole_number(1, 1'000'000));
  add_option(program.app, "--host", arguments.server.host);
  add_option(program.app, "--first-job", arguments.first_job)->default_str("");
  program.add_common({"--threads", "--json"}, library_versions());
  return program.run(argc, argv, [&] {
    if (arguments.first_job.empty()) return serve(arguments, program.common);
    refuse_given(program.app, {"--output", "--port", "--host", "--json"},
                 "does not go with --first-job, which serves no page");
    make_first_job(arguments, program.common);
  });
}
