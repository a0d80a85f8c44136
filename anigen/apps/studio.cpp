#include <chrono>
#include <filesystem>
#include <string>
#include <system_error>
#include <thread>

#include "anigen/apps/common/command_line.h"
#include "anigen/core/files.h"
#include "anigen/core/log.h"
#include "anigen/core/process.h"
#include "anigen/studio/access.h"
#include "anigen/studio/job_work.h"
#include "anigen/studio/server.h"

namespace {

using namespace anigen;
namespace fs = std::filesystem;

struct StudioArguments {
  fs::path output = "studio";
  studio::ServerOptions server;
};

/// The first start shows a creature: an example image becomes one while the page opens.
void welcome(const studio::JobStore& store, studio::Api& api, const fs::path& gallery) {
#ifdef ANIGEN_WITH_TORCH
  const fs::path image = gallery / "deer.png";
  if (store.list().empty() && !gallery.empty() && fs::exists(image)) api.submit({"deer.png", read_file(image)}, "");
#else
  static_cast<void>(store), static_cast<void>(api), static_cast<void>(gallery);
#endif
}

void serve(StudioArguments arguments, const CommonOptions& common) {
  studio::JobStore store(arguments.output);
  studio::JobWork work;
  studio::JobRunner runner(
      store, [&work](const fs::path& folder, Job& job, studio::JobRecord& record) { work.run(folder, job, record); });
  studio::Api api(store, runner);
  std::error_code ignored;
  studio::ServerOptions& options = arguments.server;
  options.page = studio::find_page(fs::read_symlink("/proc/self/exe", ignored));
  options.three = studio::find_three(options.page);
  options.gallery = studio::find_gallery(options.page);
  if (options.page.empty()) anigen::log::warn("the folder of the page was not found; the HTTP routes work without it");
  if (!options.page.empty() && options.three.empty())
    anigen::log::warn("three.js was not found, so the page shows no 3D view: npm install three, or set NODE_PATH");
  if (!studio::is_loopback(options.host)) options.token = studio::new_token();
  studio::Server server(api, options);
  print_result({{"address", server.address()}, {"output", arguments.output.string()}}, server.address() + "\n", common);
  std::fflush(stdout);
  welcome(store, api, options.gallery);
  while (!interrupt_requested()) std::this_thread::sleep_for(std::chrono::milliseconds(100));
  server.stop();
  runner.stop();
}

}  // namespace

int main(int argc, char** argv) {
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
  add_option(program.app, "--host", arguments.server.host);
  program.add_common({"--threads", "--json"}, library_versions());
  return program.run(argc, argv, [&] { serve(arguments, program.common); });
}
