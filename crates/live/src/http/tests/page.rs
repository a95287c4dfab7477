//! What can be said of the page without a browser.

use super::*;

/// The values of an attribute in a text, in any order.
fn between<'a>(text: &'a str, before: &str, after: char) -> Vec<&'a str> {
    text.split(before)
        .skip(1)
        .filter_map(|rest| rest.split(after).next())
        .collect()
}

#[test]
fn the_page_loads_nothing_from_elsewhere_and_never_makes_html_of_a_text() {
    let fixture = fixture(loopback());
    let [page, script, style] = ["/", "/live.js", "/live.css"].map(|t| fixture.get(t).body);
    for text in [&page, &script, &style] {
        for forbidden in ["http:", "https:", "@import", "url(", "javascript:"] {
            assert!(!text.contains(forbidden), "{forbidden}");
        }
    }
    for forbidden in [
        "innerHTML",
        "outerHTML",
        "insertAdjacentHTML",
        "document.write",
        "eval(",
        "new Function",
        "createContextualFragment",
        "srcdoc",
        "setAttribute(",
    ] {
        assert!(!script.contains(forbidden), "{forbidden}");
    }
    // The policy forbids scripts and styles within the page.
    for forbidden in ["<style", " style=", " onclick", " onload"] {
        assert!(!page.contains(forbidden), "{forbidden}");
    }
    assert_eq!(page.matches("<script").count(), 1);
}

#[test]
fn every_element_that_the_script_names_exists_and_every_field_has_a_label() {
    let fixture = fixture(loopback());
    let (page, script) = (fixture.get("/").body, fixture.get("/live.js").body);
    let mut ids = between(&page, " id=\"", '"');
    let n_ids = ids.len();
    ids.sort_unstable();
    ids.dedup();
    assert_eq!(ids.len(), n_ids, "ids are unique");
    let named = between(&script, "byId(\"", '"');
    assert!(named.len() > 20);
    for id in named {
        assert!(ids.contains(&id), "{id}");
    }
    for labelled in between(&page, "aria-labelledby=\"", '"') {
        assert!(ids.contains(&labelled), "{labelled}");
    }
    for line in page.lines().filter(|line| line.contains("<input")) {
        assert!(line.contains("<label"), "{line}");
    }
    for landmark in [
        "<header>",
        "<main>",
        "role=\"alert\"",
        "role=\"search\"",
        "aria-live",
    ] {
        assert!(page.contains(landmark), "{landmark}");
    }
    for wanted in ["SIMULATED", "not a medical device"] {
        assert!(page.contains(wanted), "{wanted}");
    }
}
