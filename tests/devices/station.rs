//! The station in a browser, from outside: who may see, who may act, what is stored, questions of a plan.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

const STATION: &str = r#"
schema = "hil.station/1"
id = "floor"
store = "records"
[[product]]
id = "p"
plan = "plan.toml"
simulated = true
[[site]]
name = "one"
"#;

const PLAN: &str = r#"
schema = "hil.plan/1"
name = "short"
[[setup]]
name = "fill"
stimulus.ramp = { from = "0 bar", to = "8 bar", over = "200 ms" }
[[phase]]
name = "hold"
stimulus.hold = { at = "8 bar", for = "600 ms" }
measure = [{ metric.rmse = {}, limit = { max = "5 bar" } }]
"#;

const QUESTIONS: &str = r#"
[[setup]]
name = "mounted"
prompt = { text = "Is the hose tight?" }
[[setup]]
name = "oil"
prompt = { text = "Oil temperature", answer.number = { unit = "degC", limit = { min = "35 degC", max = "45 degC" } } }
[[teardown]]
name = "leak"
prompt = { text = "Does it leak?", answer.choice = { options = ["dry", "damp", "drips"], accept = ["dry", "damp"] } }
"#;

/// A station that serves; it is ended with its scope.
struct Served {
    child: Child,
    address: String,
    token: String,
    viewer: String,
}

impl Served {
    fn begin(folder: &Path, plan: &str) -> Self {
        Self::with(folder, STATION, plan)
    }

    /// What it says on its standard error stands in the file `said`.
    fn with(folder: &Path, station: &str, plan: &str) -> Self {
        std::fs::write(folder.join("station.toml"), station).unwrap();
        std::fs::write(folder.join("plan.toml"), plan).unwrap();
        let mut child = Command::new(env!("CARGO_BIN_EXE_hil"))
            .args(["station", "station.toml", "--listen", "127.0.0.1:0", "--viewer-token"])
            .current_dir(folder)
            .stdout(Stdio::piped())
            .stderr(std::fs::File::create(folder.join("said")).unwrap())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
        let mut next = || {
            let line = lines.next().unwrap().unwrap();
            let (address, token) = line.rsplit_once("http://").unwrap().1.split_once("/#").unwrap();
            (address.to_string(), token.to_string())
        };
        let ((address, token), (_, viewer)) = (next(), next());
        Self { child, address, token, viewer }
    }

    fn enter(&self, token: &str) -> Client<'_> {
        let stranger = Client { at: &self.address, cookie: String::new(), act: String::new() };
        let answer = stranger.ask("POST", "/enter", &[], &json!({ "token": token }).to_string());
        assert_eq!(answer.status, 200, "{}", answer.body);
        let cookie = answer.head.lines().find_map(|l| l.strip_prefix("set-cookie: ")).unwrap().split(';').next().unwrap().to_string();
        let act = answer.json()["act"].as_str().unwrap_or_default().to_string();
        Client { at: &self.address, cookie, act }
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        // One that has ended already may have left its number to another program.
        if self.child.try_wait().is_ok_and(|ended| ended.is_none()) {
            let _ = Command::new("kill").arg(self.child.id().to_string()).status();
            let _ = self.child.wait();
        }
    }
}

struct Client<'a> {
    at: &'a str,
    cookie: String,
    act: String,
}

struct Answer {
    status: u16,
    head: String,
    body: String,
}

impl Answer {
    fn json(&self) -> Value {
        serde_json::from_str(&self.body).unwrap_or_else(|e| panic!("{e}: {}", self.body))
    }
}

impl Client<'_> {
    fn open(&self, method: &str, path: &str, headers: &[(&str, &str)], body: &str) -> TcpStream {
        let mut stream = TcpStream::connect(self.at).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        let host = if headers.iter().any(|h| h.0 == "host") { String::new() } else { format!("host: {}\r\n", self.at) };
        let further: String = headers.iter().map(|(name, value)| format!("{name}: {value}\r\n")).collect();
        let cookie = if self.cookie.is_empty() { String::new() } else { format!("cookie: {}\r\n", self.cookie) };
        let length = body.len();
        write!(stream, "{method} {path} HTTP/1.1\r\n{host}{cookie}connection: close\r\ncontent-length: {length}\r\n{further}\r\n{body}")
            .unwrap();
        stream
    }

    fn ask(&self, method: &str, path: &str, headers: &[(&str, &str)], body: &str) -> Answer {
        let mut text = String::new();
        let _ = self.open(method, path, headers, body).read_to_string(&mut text);
        let (head, body) = text.split_once("\r\n\r\n").unwrap_or((&text, ""));
        let status = head.split(' ').nth(1).and_then(|s| s.parse().ok()).unwrap_or(0);
        Answer { status, head: head.to_lowercase(), body: body.into() }
    }

    fn post(&self, path: &str, body: Value) -> Answer {
        self.ask("POST", path, &[("x-hil-act", &self.act), ("origin", &format!("http://{}", self.at))], &body.to_string())
    }

    fn start(&self, serial: &str) -> Answer {
        self.post("/api/start", json!({ "site": 0, "product": "p", "serial": serial, "operator": "somebody" }))
    }

    /// The board, as the stream of events gives it first.
    fn board(&self) -> Value {
        let mut lines = BufReader::new(self.open("GET", "/api/events", &[], "")).lines();
        let line = lines.find_map(|l| l.unwrap().strip_prefix("data: ").map(String::from)).unwrap();
        serde_json::from_str(&line).unwrap()
    }

    /// The site once it is as wanted.
    fn site(&self, wanted: impl Fn(&Value) -> bool) -> Value {
        let began = Instant::now();
        loop {
            let site = self.board()["sites"][0].clone();
            if wanted(&site) {
                return site;
            }
            assert!(began.elapsed() < Duration::from_secs(30), "{site}");
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

#[test]
fn a_stranger_can_neither_see_nor_act() {
    let folder = tempfile::tempdir().unwrap();
    let served = Served::begin(folder.path(), PLAN);
    let stranger = Client { at: &served.address, cookie: String::new(), act: String::new() };
    let page = stranger.ask("GET", "/", &[], "");
    assert_eq!(page.status, 200);
    assert!(
        page.head.contains("content-security-policy: default-src 'none'; script-src 'self'; style-src 'self'")
            && !page.head.contains("unsafe")
    );
    assert!(page.head.contains("x-content-type-options: nosniff") && page.head.contains("referrer-policy: no-referrer"));
    let seen = ["/api/me", "/api/events", "/api/records", "/api/figures", "/batch", "/record/1", "/picture/0"];
    for path in seen {
        assert_eq!(stranger.ask("GET", path, &[], "").status, 401, "{path}");
    }
    let acts = ["/api/check", "/api/start", "/api/stop", "/api/answer", "/api/acknowledge", "/api/close", "/leave"];
    for path in acts {
        assert_eq!(stranger.ask("POST", path, &[], "{\"site\":0}").status, 401, "{path}");
    }
    assert_eq!(stranger.ask("POST", "/enter", &[], "{\"token\":\"guess-guess-guess-guess\"}").status, 401);
    let operator = served.enter(&served.token);
    let entry = json!({ "site": 0, "product": "p", "serial": "A1", "operator": "x" }).to_string();
    // The cookie alone is not enough: a page of another origin has the browser send it.
    assert_eq!(operator.ask("POST", "/api/start", &[], &entry).status, 403);
    for origin in ["http://evil.example", "null", "http://127.0.0.1:1"] {
        let given = [("origin", origin), ("x-hil-act", operator.act.as_str())];
        assert_eq!(operator.ask("POST", "/api/start", &given, &entry).status, 403, "{origin}");
        assert_eq!(operator.ask("GET", "/api/events", &[("origin", origin)], "").status, 403, "{origin}");
    }
    assert_eq!(operator.ask("GET", "/api/records", &[("host", "evil.example")], "").status, 403, "a name that was pointed at this address");
    assert_eq!(operator.ask("GET", "/api/records", &[("sec-fetch-site", "same-site")], "").status, 403);
    assert_eq!(operator.ask("GET", "/api/start", &[], "").status, 405, "nothing begins by a GET");
    assert_eq!(operator.ask("OPTIONS", "/api/start", &[("origin", "http://evil.example")], "").status, 403, "no preflight is answered");
    let viewer = served.enter(&served.viewer);
    assert_eq!((viewer.act.as_str(), viewer.ask("GET", "/api/records", &[], "").status), ("", 200));
    assert_eq!(viewer.ask("POST", "/api/start", &[("x-hil-act", operator.act.as_str())], &entry).status, 403);
    // Nothing that a browser sends is a path.
    for id in ["..%2F..%2Fstation.toml", "%2Fetc%2Fpasswd", "x"] {
        let answer = operator.ask("GET", &format!("/record/{id}"), &[], "");
        assert_eq!(answer.status, 404, "{id}: {}", answer.body);
    }
    for serial in ["a<b", "a b", "", "é", &"9".repeat(65)] {
        assert_eq!(operator.start(serial).status, 409, "{serial}");
    }
    assert_eq!(operator.post("/api/start", json!({ "site": 7, "product": "p", "serial": "A1", "operator": "x" })).status, 409);
    assert_eq!(operator.post("/api/start", json!({ "site": 0, "product": "../p", "serial": "A1", "operator": "x" })).status, 409);
    assert_eq!(
        operator.post("/api/start", json!({ "site": 0, "product": "p", "serial": "A1", "operator": "x", "out": "/tmp" })).status,
        400
    );
    assert_eq!(operator.ask("POST", "/api/start", &[("x-hil-act", operator.act.as_str())], &"x".repeat(20_000)).status, 413);
    assert!(
        operator.ask("GET", "/api/records", &[], "").json()["attempts"].as_array().unwrap().is_empty(),
        "nothing of this has begun a test"
    );
}

#[test]
fn a_record_is_the_same_with_viewers_and_without_and_from_hil_batch() {
    let mut records = Vec::new();
    let mut traces = Vec::new();
    let run = |viewers: usize| {
        let folder = tempfile::tempdir().unwrap();
        let served = Served::begin(folder.path(), PLAN);
        let (operator, watching) = (served.enter(&served.token), served.enter(&served.viewer));
        let streams: Vec<TcpStream> = (0..viewers).map(|_| watching.open("GET", "/api/events", &[], "")).collect();
        assert_eq!(operator.start("A1").status, 200);
        let site = operator.site(|s| !s["verdict"].is_null());
        assert_eq!((site["verdict"]["outcome"].as_str(), site["light"].as_str()), (Some("PASS"), Some("idle")), "{site}");
        let refused = operator.start("A1");
        assert!(refused.status == 409 && refused.body.contains("has passed in this batch already"), "{}", refused.body);
        let page = operator.ask("GET", &format!("/record/{}", site["verdict"]["record"].as_str().unwrap()), &[], "");
        assert!(page.status == 200 && page.head.contains("sandbox") && page.body.contains("A1"));
        for mut stream in streams {
            stream.set_read_timeout(Some(Duration::from_millis(300))).unwrap();
            let mut seen = Vec::new();
            let _ = stream.read_to_end(&mut seen);
            assert!(String::from_utf8_lossy(&seen).matches("event: samples").count() > 5);
        }
        folder
    };
    for viewers in [0, 3] {
        let folder = run(viewers);
        let batch = std::fs::read_dir(folder.path().join("records")).unwrap().map(|e| e.unwrap().path()).find(|p| p.is_dir()).unwrap();
        records.push(of_record(&batch.join("valves/A1/attempt-1/record.json")));
        traces.push(std::fs::read(batch.join("valves/A1/attempt-1/trace.parquet")).unwrap());
    }
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("plan.toml"), PLAN).unwrap();
    std::fs::write(folder.path().join("lot.csv"), "serial\nA1\n").unwrap();
    let batch = ["batch", "plan.toml", "--sim", "--duts", "lot.csv", "--out", "lot"];
    assert!(Command::new(env!("CARGO_BIN_EXE_hil")).args(batch).current_dir(folder.path()).output().unwrap().status.success());
    records.push(of_record(&folder.path().join("lot/valves/A1/attempt-1/record.json")));
    traces.push(std::fs::read(folder.path().join("lot/valves/A1/attempt-1/trace.parquet")).unwrap());
    assert!(records[0] == records[1] && records[1] == records[2], "{}\n{}\n{}", records[0], records[1], records[2]);
    assert!(traces[0] == traces[1] && traces[1] == traces[2], "the samples differ");
}

/// A device that falls silent for good: the page shows it, and a station that is ended before somebody took the power away ends with 4.
#[test]
fn an_unconfirmed_safe_state_is_told_at_the_page_and_at_the_end() {
    for signal in ["-TERM", "-INT"] {
        let device = super::last_word::silent_after_then(150, || ());
        let place = format!("name = \"one\"\ntcp = \"{}\"", device.address);
        let station = STATION.replace("simulated = true", "driver = \"emulator-tcp\"").replace("name = \"one\"", &place);
        let folder = tempfile::tempdir().unwrap();
        let mut served = Served::with(folder.path(), &station, PLAN);
        let operator = served.enter(&served.token);
        assert_eq!(operator.start("A1").status, 200);
        let site = operator.site(|s| s["light"] == "unsafe");
        assert!(site.to_string().contains("NOT CONFIRMED"), "{site}");
        assert_eq!(operator.start("A2").status, 409, "nothing else is tried at that site");
        assert!(Command::new("kill").args([signal, &served.child.id().to_string()]).status().unwrap().success());
        let ended = served.child.wait().unwrap();
        let said = std::fs::read_to_string(folder.path().join("said")).unwrap();
        assert!(ended.code() == Some(4) && said.contains("SAFE STATE NOT CONFIRMED - REMOVE POWER"), "{ended:?}: {said}");
    }
}

/// A record without what says when and where it was made.
fn of_record(path: &Path) -> Value {
    let mut record: Value = serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap();
    record.as_object_mut().unwrap().remove("provenance").unwrap();
    record
}

#[test]
fn questions_are_answered_at_the_page_and_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let served = Served::begin(folder.path(), &format!("{PLAN}{QUESTIONS}"));
    let operator = served.enter(&served.token);
    assert_eq!(operator.start("Q1").status, 200);
    let asked = |text: &str| operator.site(|s| s["prompt"]["text"] == text)["prompt"].clone();
    let give = |prompt: &Value, answer: &str| operator.post("/api/answer", json!({ "site": 0, "prompt": prompt["id"], "answer": answer }));
    let mounted = asked("Is the hose tight?");
    assert_eq!(give(&mounted, "maybe").status, 409);
    assert_eq!(give(&mounted, "yes").status, 200);
    let oil = asked("Oil temperature");
    assert!(give(&mounted, "yes").body.contains("stands no longer"));
    assert!(give(&oil, "3 bar").status == 409 && give(&oil, "40,5").status == 200);
    assert_eq!(give(&asked("Does it leak?"), "damp").status, 200);
    let site = operator.site(|s| !s["verdict"].is_null());
    assert_eq!(site["verdict"]["outcome"], "PASS", "{site}");
    let batch = std::fs::read_dir(folder.path().join("records")).unwrap().map(|e| e.unwrap().path()).find(|p| p.is_dir()).unwrap();
    let record = of_record(&batch.join("valves/Q1/attempt-1/record.json"));
    let answers: Vec<_> = record["phases"].as_array().unwrap().iter().filter(|p| !p["prompt"].is_null()).map(|p| &p["prompt"]).collect();
    assert_eq!(answers.iter().map(|a| a["answer"].as_str().unwrap()).collect::<Vec<_>>(), ["yes", "40.5 degC", "damp"]);
    assert!(answers.iter().all(|a| a["by"] == "page"));
    assert_eq!(record["phases"][2]["measurements"][0]["value"], 40.5, "{record}");
    // A stop takes the question back.
    assert_eq!(operator.start("Q2").status, 200);
    asked("Is the hose tight?");
    assert_eq!(operator.post("/api/stop", json!({ "site": 0 })).status, 200);
    let site = operator.site(|s| !s["verdict"].is_null());
    assert_eq!((site["verdict"]["outcome"].as_str(), site["prompt"].is_null()), (Some("ABORTED"), true), "{site}");
}

#[test]
fn answers_come_from_a_file_where_nobody_is_there() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    write("plan.toml", &format!("{PLAN}{QUESTIONS}"));
    let hil = |args: &[&str]| {
        let out = Command::new(env!("CARGO_BIN_EXE_hil")).args(args).current_dir(folder.path()).stdin(Stdio::null()).output().unwrap();
        (out.status.code(), String::from_utf8_lossy(&out.stdout).into_owned(), String::from_utf8_lossy(&out.stderr).into_owned())
    };
    let run = |answers: &str, out: &str| {
        write("a.toml", &format!("schema = \"hil.answers/1\"\n[answers]\n{answers}"));
        hil(&["run", "plan.toml", "--sim", "--answers", "a.toml", "--format", "json", "--out", out])
    };
    let (code, _, message) = hil(&["run", "plan.toml", "--sim"]);
    assert!(code == Some(2) && message.contains("give --answers FILE") && message.contains("Is the hose tight?"), "{message}");
    let (code, record, message) = run("mounted = true\noil = 40\nleak = \"dry\"\n", "good");
    assert_eq!(code, Some(0), "{message}");
    let record: Value = serde_json::from_str(&record).unwrap();
    assert_eq!((record["outcome"].as_str(), record["phases"][1]["prompt"]["by"].as_str()), (Some("PASS"), Some("file")));
    let report = hil(&["report", "good"]).1;
    assert!(report.contains("Oil temperature") && report.contains("40 degC"), "{report}");
    // A number beyond its limit fails; a no in the setup lets nothing move.
    let (code, record, _) = run("mounted = true\noil = \"50 degC\"\nleak = \"dry\"\n", "hot");
    let record: Value = serde_json::from_str(&record).unwrap();
    assert_eq!((code, record["phases"][3]["outcome"].as_str()), (Some(1), Some("NOT_RUN")), "{record}");
    assert_eq!(run("mounted = false\noil = 40\nleak = \"dry\"\n", "no").0, Some(1));
    for (answers, wanted) in [
        (
            "mounted = true\noil = 40\n",
            "no answer to \u{201c}Does it leak?\u{201d} of the phase `leak`: one of: dry, damp, drips is wanted",
        ),
        ("mounted = true\noil = \"40 bar\"\nleak = \"dry\"\n", "answers.oil"),
        ("mounted = true\noil = 40\nleak = \"wet\"\n", "answers.leak: `wet`"),
        ("mounted = true\noil = 40\nleak = \"dry\"\nextra = 1\n", "answers.extra: the plan `short` asks nothing"),
    ] {
        let (code, _, message) = run(answers, "never");
        assert!(code == Some(3) && message.contains(wanted), "{message}");
    }
    assert!(!folder.path().join("never").exists(), "nothing began");
    assert_eq!(hil(&["check", "a.toml", "plan.toml"]).0, Some(0));
}

/// Two emulated sites on one supply take turns, and the one that waits says so.
#[test]
fn a_site_that_waits_for_the_shared_supply_says_so() {
    let station = STATION
        .replace("simulated = true", "driver = \"emulator-tcp\"")
        .replace("store = \"records\"", "store = \"records\"\nsupply = { pressure = \"40 bar\", shared = true }");
    let station = format!("{station}emulate = \"paper\"\n[[site]]\nname = \"two\"\nemulate = \"paper\"\n");
    let folder = tempfile::tempdir().unwrap();
    let served = Served::with(folder.path(), &station, &PLAN.replace("600 ms", "2 s"));
    let operator = served.enter(&served.token);
    let start = |site: usize| {
        let entry = json!({ "site": site, "product": "p", "serial": format!("S{site}"), "operator": "somebody" });
        assert_eq!(operator.post("/api/start", entry).status, 200);
    };
    let lights = || {
        let board = operator.board();
        [0, 1].map(|k| (board["sites"][k]["light"].as_str().unwrap_or_default().to_owned(), board["sites"][k]["run"].is_object()))
    };
    let (began, mut seen) = (Instant::now(), Vec::new());
    start(0);
    operator.site(|s| s["light"] == "running");
    start(1);
    while seen.last().is_none_or(|last: &[(String, bool); 2]| last.iter().any(|(light, _)| light != "idle")) {
        assert!(began.elapsed() < Duration::from_secs(60), "{seen:?}");
        seen.push(lights());
        std::thread::sleep(Duration::from_millis(20));
    }
    let is = |now: &[(String, bool); 2], first: &str, second: &str| now[0].0 == first && now[1].0 == second;
    assert!(seen.iter().any(|now| is(now, "running", "waiting") && now[1].1), "{seen:?}");
    assert!(seen.iter().any(|now| now[1].0 == "running"), "the second had its turn: {seen:?}");
}
