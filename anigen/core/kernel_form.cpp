#include "anigen/core/kernel_form.h"

#include <algorithm>
#include <cstdlib>
#include <iterator>

#include "anigen/core/error.h"
#include "anigen/core/text.h"

namespace anigen {

namespace {

constexpr KernelForm kForms[] = {KernelForm::kPortable, KernelForm::kAvx2, KernelForm::kAvx512,
                                 KernelForm::kAvx512Bf16};

bool runs(KernelForm form) {
  if (form == KernelForm::kPortable) return true;
#if defined(__x86_64__) && defined(__GNUC__)
  const bool avx2 = __builtin_cpu_supports("avx2") != 0 && __builtin_cpu_supports("fma") != 0;
  const bool avx512 = avx2 && __builtin_cpu_supports("avx512f") != 0;
  if (form == KernelForm::kAvx2) return avx2;
  if (form == KernelForm::kAvx512) return avx512;
  return avx512 && __builtin_cpu_supports("avx512bf16") != 0 && __builtin_cpu_supports("avx512bw") != 0 &&
         __builtin_cpu_supports("avx512vl") != 0 && __builtin_cpu_supports("avx512dq") != 0;
#else
  return false;
#endif
}

std::string names(const std::vector<KernelForm>& forms) { return joined(forms, ", ", kernel_form_name); }

void require_runnable(KernelForm form) {
  const std::vector<KernelForm>& forms = runnable_kernel_forms();
  if (std::find(forms.begin(), forms.end(), form) != forms.end()) return;
  throw InputError("", "ANIGEN_KERNELS",
                   std::string("this processor does not run kernels in the form ") + kernel_form_name(form) +
                       "; it runs " + names(forms));
}

}  // namespace

std::atomic<int> kernel_forms::current{-1};

KernelForm kernel_forms::first_choice() {
  const char* value = std::getenv("ANIGEN_KERNELS");
  const KernelForm form = requested_kernel_form(value == nullptr ? "" : value);
  int nothing = -1;
  current.compare_exchange_strong(nothing, static_cast<int>(form));
  return static_cast<KernelForm>(current.load());
}

const char* kernel_form_name(KernelForm form) {
  static constexpr const char* kNames[] = {"portable", "avx2", "avx512", "avx512bf16"};
  return kNames[static_cast<int>(form)];
}

const std::vector<KernelForm>& runnable_kernel_forms() {
  static const std::vector<KernelForm> forms = [] {
    std::vector<KernelForm> found;
    std::copy_if(std::begin(kForms), std::end(kForms), std::back_inserter(found), runs);
    return found;
  }();
  return forms;
}

KernelForm requested_kernel_form(const std::string& value) {
  if (value.empty()) return runnable_kernel_forms().back();
  for (const KernelForm form : kForms) {
    if (value != kernel_form_name(form)) continue;
    require_runnable(form);
    return form;
  }
  throw InputError(
      "", "ANIGEN_KERNELS",
      "unknown form of kernels \"" + value + "\"; set it to portable, avx2, avx512 or avx512bf16, or unset it");
}

std::string kernel_form_details() {
  return std::string("kernels ") + kernel_form_name(kernel_form()) + " (this processor runs " +
         names(runnable_kernel_forms()) + ")";
}

KernelFormScope::KernelFormScope(KernelForm form) : before_(kernel_form()) {
  require_runnable(form);
  kernel_forms::current = static_cast<int>(form);
}

KernelFormScope::~KernelFormScope() { kernel_forms::current = static_cast<int>(before_); }

}  // namespace anigen
