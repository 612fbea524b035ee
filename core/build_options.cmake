# teres::options: what every target of the house is compiled with. Linked PRIVATE; never global flags.
add_library(teres_options INTERFACE)
add_library(teres::options ALIAS teres_options)
target_compile_features(teres_options INTERFACE cxx_std_20)
target_include_directories(teres_options INTERFACE ${PROJECT_SOURCE_DIR} ${PROJECT_BINARY_DIR})
target_compile_options(teres_options INTERFACE -Wall -Wextra -Wshadow -Wnon-virtual-dtor -Woverloaded-virtual
  $<$<BOOL:${TERES_WERROR}>:-Werror> -fno-math-errno -ffp-contract=off -Wno-psabi)
target_compile_definitions(teres_options INTERFACE TERES_VERSION="${PROJECT_VERSION}")
if(TERES_SANITIZE)
  target_compile_options(teres_options INTERFACE -fsanitize=${TERES_SANITIZE} -fno-omit-frame-pointer)
  target_link_options(teres_options INTERFACE -fsanitize=${TERES_SANITIZE})
endif()
if(TERES_BUILD_FUZZERS)
  # coverage of the libraries guides the fuzzers
  target_compile_options(teres_options INTERFACE -fsanitize=fuzzer-no-link)
  target_link_options(teres_options INTERFACE -fsanitize=fuzzer-no-link)
endif()
