// Verbs about a session folder, and what they take.
#include "cli/verb_list.h"

#include <memory>
#include <string>

namespace lightrig::cli {

void add_session_verbs(Verbs& verbs) {
  auto reduce_options = std::make_shared<ReduceOptions>();
  CLI::App* verb = with_json(
      verbs.add("reduce", "Frames to BRDF again, from the folder alone", reduce_options, &reduce),
      reduce_options->json);
  verb->add_option("session", reduce_options->session, "Session folder")->required();
  verb->add_option("-o,--output", reduce_options->output, "Write here instead of the folder");
  verb->add_option("--environment", reduce_options->environment,
                   "Light the report's sphere by this latitude-longitude picture (EXR, HDR)");
  add_threads(verb, reduce_options->threads);

  auto verify_options = std::make_shared<ReduceOptions>();
  verb = with_json(verbs.add("verify", "Prove a session folder: checksums, journal, reduction",
                             verify_options, &verify),
                   verify_options->json);
  verb->add_option("session", verify_options->session, "Session folder")->required();
  add_threads(verb, verify_options->threads);

  auto folder = std::make_shared<std::string>();
  auto json = std::make_shared<bool>(false);
  verb = with_json(verbs.add("result", "What a session found, what it cost, what it left out",
                             [folder, json] { return result(*folder, *json); }),
                   *json);
  verb->add_option("session", *folder, "Session folder")->required();

  auto again = std::make_shared<std::string>();
  auto shot = std::make_shared<std::string>();
  auto retaker = std::make_shared<ServiceOptions>();
  verb = with_service(verbs.add("retake", "Open a captured shot again; its frames are kept",
                                [retaker, again, shot] { return retake(*retaker, *again, *shot); }),
                      *retaker);
  verb->add_option("session", *again, "Session folder, or its id at the service")->required();
  verb->add_option("shot", *shot, "Name of the shot, e.g. L03")->required();

  auto compare_options = std::make_shared<CompareOptions>();
  verb =
      with_json(verbs.add("compare", "Errors of BRDF A against BRDF B", compare_options, &compare),
                compare_options->json);
  verb->add_option("a", compare_options->a, "MERL file or session folder")->required();
  verb->add_option("b", compare_options->b, "MERL file or session folder: the truth")->required();
  verb->add_option("--picture", compare_options->picture, "Write a picture of both (PNG)");
  verb->add_option("--floor", compare_options->floor, "Floor of the logarithm [1/sr]")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();

  auto source = std::make_shared<std::string>();
  auto merl = std::make_shared<std::string>();
  verb = verbs.add("export", "A session's BRDF as a full MERL file",
                   [source, merl] { return export_merl(*source, *merl); });
  verb->add_option("session", *source, "Session folder")->required();
  verb->add_option("--merl", *merl, "File to write")->required();
}

}  // namespace lightrig::cli
