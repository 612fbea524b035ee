# teres_add_plugin(<name> SOURCES a.cpp b.cpp [PLUGIN plugin.cpp] [LINK target...])
#   static library teres_<name> (alias teres::<name>) for tests and offline commands, and, from PLUGIN (default
#   plugin.cpp), the module <build>/lib/teres/plugins/teres_<name>.so that the plugin host loads.
function(teres_add_plugin name)
  cmake_parse_arguments(ARG "" "PLUGIN" "SOURCES;LINK" ${ARGN})
  if(NOT ARG_PLUGIN)
    set(ARG_PLUGIN plugin.cpp)
  endif()
  add_library(teres_${name} STATIC ${ARG_SOURCES})
  add_library(teres::${name} ALIAS teres_${name})
  target_link_libraries(teres_${name} PUBLIC teres::core ${ARG_LINK} PRIVATE teres::options)
  add_library(teres_${name}_plugin MODULE ${ARG_PLUGIN})
  set_target_properties(teres_${name}_plugin PROPERTIES PREFIX "" OUTPUT_NAME teres_${name}
    LIBRARY_OUTPUT_DIRECTORY ${TERES_PLUGIN_OUTPUT_DIRECTORY}
    CXX_VISIBILITY_PRESET hidden VISIBILITY_INLINES_HIDDEN ON)
  target_link_libraries(teres_${name}_plugin PRIVATE teres_${name} teres::options)
  target_link_options(teres_${name}_plugin PRIVATE -Wl,--exclude-libs,ALL)
  if(NOT TARGET teres_plugins)
    add_custom_target(teres_plugins)  # all modules that the program loads
  endif()
  add_dependencies(teres_plugins teres_${name}_plugin)
  install(TARGETS teres_${name}_plugin LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR}/teres/plugins)
endfunction()

# teres_add_test(<path/noun> LINK target... [SOURCES more.cpp] [LABELS l...] [TIMEOUT s] [WRAPPER program]): tests/<path/noun>_test.cpp
function(teres_add_test path)
  cmake_parse_arguments(ARG "" "TIMEOUT" "SOURCES;LINK;LABELS;WRAPPER" ${ARGN})
  string(REPLACE "/" "_" target ${path}_test)
  add_executable(${target} ${PROJECT_SOURCE_DIR}/tests/${path}_test.cpp ${ARG_SOURCES})
  target_link_libraries(${target} PRIVATE ${ARG_LINK} teres::test_support teres::options GTest::gmock GTest::gtest_main)
  if(CMAKE_CROSSCOMPILING)  # the bare name of the target: CMake puts the emulator before it
    add_test(NAME ${path} COMMAND ${target} --gtest_color=no)
  else()
    add_test(NAME ${path} COMMAND ${ARG_WRAPPER} $<TARGET_FILE:${target}> --gtest_color=no)
  endif()
  if(NOT ARG_TIMEOUT)
    set(ARG_TIMEOUT 300)
  endif()
  set_tests_properties(${path} PROPERTIES TIMEOUT ${ARG_TIMEOUT} LABELS "${ARG_LABELS}"
    ENVIRONMENT "TERES_TEST_DATA=$ENV{TERES_TEST_DATA};TERES_BUILD_DIR=${PROJECT_BINARY_DIR};TERES_SOURCE_DIR=${PROJECT_SOURCE_DIR}")
endfunction()

# teres_add_fuzzer(<name> SOURCES f.cpp LINK target...): libFuzzer program, clang only
function(teres_add_fuzzer name)
  cmake_parse_arguments(ARG "" "" "SOURCES;LINK" ${ARGN})
  if(TERES_BUILD_FUZZERS)
    add_executable(fuzz_${name} ${ARG_SOURCES})
    target_link_libraries(fuzz_${name} PRIVATE ${ARG_LINK} teres::options)
    target_compile_options(fuzz_${name} PRIVATE -fsanitize=fuzzer)
    target_link_options(fuzz_${name} PRIVATE -fsanitize=fuzzer)
  endif()
endfunction()
