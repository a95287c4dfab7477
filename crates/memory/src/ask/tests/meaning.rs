//! Tables of questions.

use super::*;

#[test]
fn questions_have_their_meaning() {
    use Kind::*;
    const ALWAYS: &str = "always to now";
    const TODAY: &str = "2026-11-23 00:00 to now";
    const YESTERDAY: &str = "2026-11-22 00:00 to 2026-11-23 00:00";
    const LAST_NIGHT: &str = "2026-11-22 20:00 to 2026-11-23 08:00";
    for (question, kind, actions, when) in [
        ("When did she last get up?", Last, "stand_up", ALWAYS),
        ("when did she last fall?", Last, "fall", ALWAYS),
        (
            "How often did she get up today?",
            HowOften,
            "stand_up",
            TODAY,
        ),
        ("how often has he got up today", HowOften, "stand_up", TODAY),
        (
            "How many times did anyone sit down yesterday?",
            HowOften,
            "sit_down",
            YESTERDAY,
        ),
        ("When was the last time someone fell?", Last, "fall", ALWAYS),
        ("last fall", Last, "fall", ALWAYS),
        (
            "LAST TIME SHE WALKED",
            Last,
            "walk pace circle limp",
            ALWAYS,
        ),
        (
            "When did she first get up this morning?",
            First,
            "stand_up",
            "2026-11-23 04:00 to 2026-11-23 12:00",
        ),
        (
            "What time did he first stand up today?",
            First,
            "stand_up",
            TODAY,
        ),
        (
            "When did she get up last night?",
            When,
            "stand_up",
            LAST_NIGHT,
        ),
        (
            "When did she last get up last night?",
            Last,
            "stand_up",
            LAST_NIGHT,
        ),
        (
            "Did she get up yesterday night?",
            Did,
            "stand_up",
            "2026-11-22 20:00 to 2026-11-23 08:00",
        ),
        ("Did anybody fall?", Did, "fall", ALWAYS),
        ("Did she ever fall over?", Did, "fall", ALWAYS),
        (
            "Has anyone fallen since 07:30?",
            Did,
            "fall",
            "2026-11-23 07:30 to now",
        ),
        (
            "has anyone fallen since 7:30 am",
            Did,
            "fall",
            "2026-11-23 07:30 to now",
        ),
        (
            "Has anyone fallen since 22:00?",
            Did,
            "fall",
            "2026-11-22 22:00 to now",
        ),
        (
            "Has anyone fallen since 10 p.m.?",
            Did,
            "fall",
            "2026-11-22 22:00 to now",
        ),
        ("did she fall since 12am", Did, "fall", TODAY),
        (
            "did she fall since noon",
            Did,
            "fall",
            "2026-11-23 12:00 to now",
        ),
        ("did she fall since midnight", Did, "fall", TODAY),
        (
            "did she fall since 7 o'clock",
            Did,
            "fall",
            "2026-11-23 07:00 to now",
        ),
        (
            "did she fall since yesterday",
            Did,
            "fall",
            "2026-11-22 00:00 to now",
        ),
        (
            "did she fall since yesterday evening",
            Did,
            "fall",
            "2026-11-22 18:00 to now",
        ),
        (
            "did she fall since Friday?",
            Did,
            "fall",
            "2026-11-20 00:00 to now",
        ),
        (
            "did she fall since 2026-11-01",
            Did,
            "fall",
            "2026-11-01 00:00 to now",
        ),
        (
            "Did she fall on 2026-11-20?",
            Did,
            "fall",
            "2026-11-20 00:00 to 2026-11-21 00:00",
        ),
        (
            "Did she fall on Friday?",
            Did,
            "fall",
            "2026-11-20 00:00 to 2026-11-21 00:00",
        ),
        ("Did she fall on Monday?", Did, "fall", TODAY),
        (
            "Did she fall last Monday?",
            Did,
            "fall",
            "2026-11-16 00:00 to 2026-11-17 00:00",
        ),
        (
            "Did she fall on Tuesday in the morning?",
            Did,
            "fall",
            "2026-11-17 04:00 to 2026-11-17 12:00",
        ),
        (
            "Did she get up on 2026-11-20 at night?",
            Did,
            "stand_up",
            "2026-11-20 20:00 to 2026-11-21 08:00",
        ),
        (
            "Did she fall on Tuesday morning?",
            Did,
            "fall",
            "2026-11-17 04:00 to 2026-11-17 12:00",
        ),
        (
            "How often did she fall in the last 3 hours?",
            HowOften,
            "fall",
            "2026-11-23 15:38 to now",
        ),
        (
            "How often did she fall in the past hour?",
            HowOften,
            "fall",
            "2026-11-23 17:38 to now",
        ),
        (
            "how often did she fall within the last two days",
            HowOften,
            "fall",
            "2026-11-21 18:38 to now",
        ),
        (
            "how often did she fall in the last week",
            HowOften,
            "fall",
            "2026-11-16 18:38 to now",
        ),
        (
            "how often did she fall last week",
            HowOften,
            "fall",
            "2026-11-16 00:00 to 2026-11-23 00:00",
        ),
        ("how often did she fall this week", HowOften, "fall", TODAY),
        (
            "How long did she sit today?",
            HowLong,
            "sit_still sit_down",
            TODAY,
        ),
        (
            "how long was he lying down yesterday",
            HowLong,
            "lie_down",
            YESTERDAY,
        ),
        (
            "How much time did they spend walking this afternoon?",
            HowLong,
            "walk pace circle limp",
            "2026-11-23 12:00 to 2026-11-23 18:00",
        ),
        (
            "How long ago did she last get up?",
            Last,
            "stand_up",
            ALWAYS,
        ),
        (
            "how long has it been since she drank",
            Last,
            "drink",
            ALWAYS,
        ),
        (
            "When did she get out of bed today?",
            When,
            "stand_up",
            TODAY,
        ),
        (
            "Was she kneeling this evening?",
            Did,
            "kneel",
            "2026-11-23 18:00 to now",
        ),
        (
            "did he or she wave tonight",
            Did,
            "wave",
            "2026-11-23 18:00 to now",
        ),
        (
            "Did she walk or run yesterday morning?",
            Did,
            "walk run pace circle limp",
            "2026-11-22 04:00 to 2026-11-22 12:00",
        ),
        ("when did she pick something up", When, "pick_up", ALWAYS),
        (
            "when did she raise a hand and wave today",
            When,
            "wave",
            TODAY,
        ),
        ("Yesterday, did she jump?", Did, "jump", YESTERDAY),
        ("how many falls yesterday?", HowOften, "fall", YESTERDAY),
        ("number of falls", HowOften, "fall", ALWAYS),
        ("any falls today?", Did, "fall", TODAY),
        ("falls today", Did, "fall", TODAY),
        ("was there an alarm today?", Did, "fall", TODAY),
        ("can you tell me whether she fell?", Did, "fall", ALWAYS),
        (
            "when did she go to bed yesterday?",
            When,
            "lie_down",
            YESTERDAY,
        ),
        ("when did she wake up today?", When, "stand_up", TODAY),
        (
            "how often was she up at night?",
            HowOften,
            "stand_up",
            LAST_NIGHT,
        ),
    ] {
        let understood = match what::understand(question, &CLOCK) {
            Ok(understood) => understood,
            Err(e) => panic!("{question}: {e:?}"),
        };
        assert_eq!(understood.what.kind, kind, "{question}");
        assert_eq!(understood.what.actions.join(" "), actions, "{question}");
        assert_eq!(range(&understood.when), when, "{question}");
        assert!(
            understood.ignored.is_empty(),
            "{question}: {:?}",
            understood.ignored
        );
    }
}

#[test]
fn questions_outside_the_grammar_are_refused_and_not_guessed() {
    let action = "it names no known action";
    let time = "it names a time in words that are not known";
    let several = "it asks for several things";
    let combination = "it names a combination of actions";
    let negation = "it asks for what did not happen, or for what is usual";
    let comparison = "it compares times with each other";
    let kind = "it does not ask when, how often, how long or whether";
    for (question, why) in [
        ("", kind),
        ("?", kind),
        ("get up", kind),
        ("Is she walking?", kind),
        ("What did she do today?", kind),
        ("Why did she fall?", kind),
        ("when did she eat", action),
        ("When did she fall asleep?", action),
        ("did she turn on the light", action),
        ("When did she not get up?", negation),
        ("Didn\u{2019}t she get up?", negation),
        ("When does she usually get up?", negation),
        ("when did she stop walking", negation),
        ("did nobody fall", negation),
        ("did she fall since breakfast", time),
        ("did she fall twice", time),
        ("did she get up 3 times", time),
        ("did she fall on 2026-02-30", time),
        ("did she fall in the last 99999999999999999999 hours", time),
        ("did she fall since 25:00", time),
        ("did she fall since 7:60", time),
        ("did she fall since 13 pm", time),
        ("did she fall last year", time),
        ("did she fall after getting up", time),
        ("did she fall before breakfast", time),
        ("did she fall at 25:00", time),
        ("did she fall on 31 November", time),
        ("did she fall at 7 last week", time),
        ("did she get up more often than yesterday", comparison),
        ("did she walk and sit down", combination),
        ("did she walk while waving", time),
        ("how long did she last sit", several),
        ("when did who fall", several),
        ("how often and when did she fall", several),
        ("did she fall next", several),
        ("did she fall tomorrow", time),
        ("did she fall on 2026-12-24", "its time has not begun"),
        (&"when ".repeat(41), "it has too many words"),
    ] {
        let refused = what::understand(question, &CLOCK).map(|u| format!("{u:?}"));
        assert_eq!(refused.map_err(|e| e.why), Err(why), "{question}");
    }
}

#[test]
fn phrases_of_time_have_their_range() {
    const YESTERDAY: &str = "2026-11-22 00:00 to 2026-11-23 00:00";
    const LAST_NIGHT: &str = "2026-11-22 20:00 to 2026-11-23 08:00";
    const TWO_DAYS_AGO: &str = "2026-11-21 00:00 to 2026-11-22 00:00";
    const FRIDAY: &str = "2026-11-20 00:00 to 2026-11-21 00:00";
    for (time, expected) in [
        ("at 07:30", "2026-11-23 07:15 to 2026-11-23 07:45"),
        ("at 3 am", "2026-11-23 02:30 to 2026-11-23 03:30"),
        // Still to come today.
        ("at about 22:00", "2026-11-22 21:45 to 2026-11-22 22:15"),
        ("at 14:10 yesterday", "2026-11-22 13:55 to 2026-11-22 14:25"),
        (
            "yesterday around 2 pm",
            "2026-11-22 13:30 to 2026-11-22 14:30",
        ),
        ("last night at 3 am", "2026-11-23 02:30 to 2026-11-23 03:30"),
        (
            "between 14:00 and 15:00",
            "2026-11-23 14:00 to 2026-11-23 15:00",
        ),
        ("between 2 and 3 pm", "2026-11-23 14:00 to 2026-11-23 15:00"),
        (
            "from 10 am to 1 pm yesterday",
            "2026-11-22 10:00 to 2026-11-22 13:00",
        ),
        (
            "between 22:00 and 6:00",
            "2026-11-22 22:00 to 2026-11-23 06:00",
        ),
        ("before noon", "2026-11-23 00:00 to 2026-11-23 12:00"),
        ("before 6", "2026-11-23 00:00 to 2026-11-23 06:00"),
        ("after 7", "2026-11-23 07:00 to now"),
        ("after midnight", "2026-11-23 00:00 to now"),
        ("after 22:00", "2026-11-22 22:00 to now"),
        (
            "after 9 pm yesterday",
            "2026-11-22 21:00 to 2026-11-23 00:00",
        ),
        ("since noon yesterday", "2026-11-22 12:00 to now"),
        ("at night", LAST_NIGHT),
        ("during the night", LAST_NIGHT),
        ("overnight", LAST_NIGHT),
        ("in the morning", "2026-11-23 04:00 to 2026-11-23 12:00"),
        ("two days ago", TWO_DAYS_AGO),
        ("the day before yesterday", TWO_DAYS_AGO),
        ("a week ago", "2026-11-16 00:00 to 2026-11-17 00:00"),
        ("yesterday or today", "2026-11-22 00:00 to now"),
        ("on 20 November", FRIDAY),
        ("on November 20", FRIDAY),
        ("on the 20th of November 2026", FRIDAY),
        // The last such day.
        ("on 28 November", "2025-11-28 00:00 to 2025-11-29 00:00"),
        ("this month", "2026-11-01 00:00 to now"),
        ("last month", "2026-10-01 00:00 to 2026-11-01 00:00"),
        ("yesterday", YESTERDAY),
    ] {
        let question = format!("did she fall {time}?");
        let understood = match what::understand(&question, &CLOCK) {
            Ok(understood) => understood,
            Err(e) => panic!("{question}: {e:?}"),
        };
        assert_eq!(range(&understood.when), expected, "{question}");
        assert_eq!(understood.what.actions, ["fall"], "{question}");
        assert!(understood.ignored.is_empty(), "{question}");
    }
    let phrase = |question: &str| what::understand(question, &CLOCK).unwrap().when.phrase;
    assert_eq!(
        phrase("did she fall at 3 am"),
        "around 03:00 today (02:30 to 03:30)"
    );
    assert_eq!(
        phrase("did she fall between 14:00 and 15:00 yesterday"),
        "from 14:00 to 15:00 yesterday"
    );
}
