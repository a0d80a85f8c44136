#include "anigen/nn/blas.h"

#include <dlfcn.h>

#include <filesystem>
#include <system_error>

#include "anigen/core/log.h"
#include "anigen/nn/torch.h"

namespace anigen::nn {
namespace {

// Libraries that LibTorch links as libblas.so.3 are alternatives behind a link; its target names the package.
std::string real_path(const char* path) {
  std::error_code error;
  const std::filesystem::path real = std::filesystem::canonical(path, error);
  return error ? std::string(path) : real.string();
}

std::string flavour_of(const std::string& library) {
  const auto mentions = [&](const char* word) { return library.find(word) != std::string::npos; };
  for (const char* flavour : {"openblas-openmp", "openblas-pthread", "openblas-serial"}) {
    if (mentions(flavour)) return flavour;
  }
  if (mentions("mkl")) return "mkl";
  if (mentions("/blas/libblas")) return "reference";
  return "unknown";
}

}  // namespace

Blas find_blas() {
  Blas blas;
  Dl_info info{};
  void* product = dlsym(RTLD_DEFAULT, "sgemm_");
  if (product != nullptr && dladdr(product, &info) != 0 && info.dli_fname != nullptr) {
    blas.library = real_path(info.dli_fname);
  }
  blas.flavour = blas.library.empty() ? "unknown" : flavour_of(blas.library);
  return blas;
}

void warn_about_blas() {
  const Blas blas = find_blas();
  if (blas.flavour == "reference") {
    log::warn(
        "the reference BLAS ({}) is in use: matrix products are some 35 times slower than they could be; install "
        "libopenblas0-openmp",
        blas.library);
  } else if (blas.flavour == "openblas-pthread" || blas.flavour == "openblas-serial") {
    log::warn("{} ({}) is in use, whose threads do not get on with LibTorch's; install libopenblas0-openmp",
              blas.flavour, blas.library);
  }
}

std::string version_details() {
  const Blas blas = find_blas();
  return std::string("LibTorch ") + TORCH_VERSION + "\nBLAS " + blas.flavour +
         (blas.library.empty() ? "" : " (" + blas.library + ")") + "\nCUDA " +
         (torch::cuda::is_available() ? std::to_string(torch::cuda::device_count()) + " devices" : "not available");
}

}  // namespace anigen::nn
