//! Sweeps: the front against its definition, results from former runs, and written files.

use crate::common;
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::SystemTime;

use crate::common::{Random, assert_schema, fixture, folder};
use mipvog::base::error::ErrorKind;
use mipvog::base::limits::Limits;
use mipvog::base::progress::{Progress, Silent, Step};
use mipvog::model::camera::{Camera, turntable};
use mipvog::view::compare::{Reference, References};
use mipvog::view::render::Renderer;
use mipvog_bake::sweep::{Grid, Point, Setting, Share, SweepOptions, SweepReport, front, sweep};
use mipvog_inputs::{Source, SourceOptions};

fn tiny() -> Source {
    let path = fixture("trained/tiny/fine_last.tar");
    mipvog_inputs::open_with(&path, &SourceOptions::default(), &Limits::default())
        .expect("a checkpoint")
}

fn cameras(source: &Source, count: usize) -> Vec<Camera> {
    turntable(&source.field.scene.bounds, count, [24, 16])
}

fn options(bits: &[u32]) -> SweepOptions {
    let texts: Vec<String> = bits.iter().map(u32::to_string).collect();
    let texts: Vec<&str> = texts.iter().map(String::as_str).collect();
    let mut options = SweepOptions::default();
    options.settings = Grid::default().with("bits", &texts).settings().expect("values");
    options.scales = vec![2, 1];
    options.repeat = 1;
    options
}

fn run(folder: &Path, options: &SweepOptions) -> SweepReport {
    let source = tiny();
    sweep(&source, &cameras(&source, 2), options, folder, &Silent).expect("a sweep")
}

fn resumed(report: &SweepReport) -> Vec<bool> {
    report.settings.iter().map(|setting| setting.resumed).collect()
}

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).expect("text")
}

/// The definition: no other is at least as good in both and better in one; of equals the first.
fn is_on_front(points: &[Point], i: usize) -> bool {
    let own = points[i];
    let beaten = |(j, other): (usize, &Point)| {
        let as_good = other.cost <= own.cost && other.quality >= own.quality;
        as_good && (other.cost < own.cost || other.quality > own.quality || j < i)
    };
    !points.iter().enumerate().any(beaten)
}

#[test]
fn the_front_is_what_its_definition_says() {
    for seed in 0..2000 {
        let mut random = Random::new(seed);
        // Few values, so that there are ties of every kind.
        let values = 1 + random.below(12);
        let point = |random: &mut Random| Point {
            cost: random.below(values) as f64,
            quality: random.below(values) as f64,
        };
        let count = random.below(20);
        let points: Vec<Point> = (0..count).map(|_| point(&mut random)).collect();
        let want: Vec<bool> = (0..count).map(|i| is_on_front(&points, i)).collect();
        assert_eq!(front(&points), want, "seed {seed}: {points:?}");
    }
    let unknown = Point { cost: f64::NAN, quality: 1.0 };
    assert_eq!(front(&[unknown, Point { cost: 1.0, quality: 0.0 }]), [false, true]);
}

#[test]
fn a_finished_setting_is_not_baked_again() {
    let folder = folder();
    let here = folder.path();
    let path = |name: &str| here.join(name);
    let first = run(here, &options(&[6, 8]));
    assert_eq!(resumed(&first), [false, false]);
    let old = SystemTime::UNIX_EPOCH + std::time::Duration::from_secs(1_000_000_000);
    for setting in &first.settings {
        let file = std::fs::File::options().write(true).open(path(&setting.file)).expect("baked");
        file.set_modified(old).expect("a time");
    }
    // Another list that holds both: only new settings are baked.
    let second = run(here, &options(&[8, 12, 6]));
    assert_eq!(resumed(&second), [true, false, true]);
    assert_eq!(second.settings[2].errors, first.settings[0].errors);
    assert_eq!(second.settings[2].seconds, first.settings[0].seconds);
    for setting in &first.settings {
        let modified = path(&setting.file).metadata().and_then(|found| found.modified());
        assert_eq!(modified.expect("a time"), old, "{}", setting.name);
    }
    assert!(first.settings[0].output_bytes < second.settings[1].output_bytes);

    // A change of anything that the result follows from makes it anew: a lost or cut container, a
    // damaged record, other cameras, scales or repetitions.
    let names = ["rate-tent-6bit-t1e-3-b8-z1", "rate-tent-8bit-t1e-3-b8-z1"];
    std::fs::remove_file(path(&format!("{}.mipvog", names[0]))).expect("removed");
    assert_eq!(resumed(&run(here, &options(&[6, 8]))), [false, true]);
    std::fs::write(path(&format!("{}.mipvog", names[1])), b"cut").expect("written");
    assert_eq!(resumed(&run(here, &options(&[6, 8]))), [true, false]);
    let record = path(&format!("{}.json", names[0]));
    let text = read(&record).replace("\"output_bytes\"", "\"bytes\"");
    std::fs::write(record, text).expect("written");
    assert_eq!(resumed(&run(here, &options(&[6, 8]))), [false, true]);
    let source = tiny();
    let other = sweep(&source, &cameras(&source, 1), &options(&[6]), here, &Silent);
    assert_eq!(resumed(&other.expect("a sweep")), [false]);
    let mut twice = options(&[8]);
    twice.repeat = 2;
    assert_eq!(resumed(&run(here, &twice)), [false]);
}

#[test]
fn results_do_not_depend_on_threads_or_folders() {
    let folders = [folder(), folder()];
    let reports: Vec<SweepReport> = [1, 3]
        .into_iter()
        .zip(&folders)
        .map(|(threads, folder)| {
            common::with_threads(threads, || run(folder.path(), &options(&[4, 8])))
        })
        .collect();
    for (one, other) in reports[0].settings.iter().zip(&reports[1].settings) {
        let read = |folder: usize| std::fs::read(folders[folder].path().join(&one.file));
        assert!(read(0).expect("baked") == read(1).expect("baked"), "{}", one.name);
        assert_eq!(one.errors, other.errors);
        let bytes = |setting: &mipvog_bake::sweep::SettingReport| -> Vec<bool> {
            setting.fronts.iter().map(|fronts| fronts.bytes).collect()
        };
        assert_eq!(bytes(one), bytes(other));
    }
}

#[test]
fn a_setting_that_fails_does_not_end_the_sweep() {
    let folder = folder();
    let mut options = options(&[8]);
    let mut impossible = options.settings[0].options.clone();
    impossible.block_size = 0;
    options.settings.insert(0, Setting::new(impossible));
    let report = run(folder.path(), &options);
    let failure = report.settings[0].failure.as_deref().expect("a failure");
    assert!(failure.contains("option block_size"), "{failure}");
    assert_schema("sweep", &serde_json::to_value(&report).expect("JSON"));
    assert!(report.settings[0].fronts.is_empty() && report.settings[1].failure.is_none());
    assert!(report.settings[1].fronts.iter().all(|fronts| fronts.bytes && fronts.seconds));
    assert!(read(&folder.path().join("sweep.html")).contains("failed: "));
    // It is tried again, in case it was not the setting's fault.
    assert_eq!(resumed(&run(folder.path(), &options)), [false, true]);
}

#[test]
fn files_of_others_are_left_alone() {
    let name = "rate-tent-8bit-t1e-3-b8-z1";
    for taken in ["sweep.html", "sweep.json", &format!("{name}.json"), &format!("{name}.mipvog")] {
        let folder = folder();
        let path = folder.path().join(taken);
        std::fs::write(&path, b"{\"mine\": 1}").expect("written");
        let source = tiny();
        let cameras = cameras(&source, 1);
        let mut options = options(&[8]);
        let refused = sweep(&source, &cameras, &options, folder.path(), &Silent);
        let error = refused.expect_err("a foreign file");
        assert!(matches!(error.kind(), ErrorKind::Exists), "{taken}: {error}");
        assert_eq!(error.file(), Some(path.as_path()));
        assert_eq!(std::fs::read_dir(folder.path()).expect("a folder").count(), 1, "{taken}");
        options.overwrite = true;
        sweep(&source, &cameras, &options, folder.path(), &Silent).expect("a sweep");
    }
}

#[test]
fn the_page_needs_no_other_and_the_table_has_a_row_for_each() {
    let folder = folder();
    let report = run(folder.path(), &options(&[4, 6, 8]));
    let html = read(&folder.path().join("sweep.html"));
    for outside in ["http", "<script", "<link", "@import", "url(", "src=\"/"] {
        assert!(!html.contains(outside), "{outside}");
    }
    // It leads to the containers beside it, and nowhere else.
    let links = html.split(" href=\"").skip(1).filter_map(|rest| rest.split('"').next());
    let files: Vec<&str> = report.settings.iter().map(|setting| &*setting.file).collect();
    assert_eq!(links.collect::<Vec<_>>(), files);
    // The trade-off is judged at full size, which need not be the first scale.
    let recommended = report.recommended().expect("a setting");
    let full = report.scales.iter().position(|&scale| scale == 1).expect("full size");
    assert!(recommended.fronts[full].bytes, "{}", recommended.name);
    assert_balanced(&html);
    // Two plots a scale, a point for each result in each.
    let (scales, settings) = (report.scales.len(), report.settings.len());
    assert_eq!(html.matches("<title>").count(), 1 + 2 * scales * settings);
    assert!(html.contains("prefers-color-scheme: dark") && !html.contains("NaN"));
    // Each setting has a picture, the one to recommend has a ring in each plot.
    assert_eq!(html.matches("src=\"data:image/png;base64,").count(), settings);
    assert_eq!(html.matches("class=\"halo\"").count(), 2 * scales);
    assert!(html.contains(&format!("Recommended: <strong>{}</strong>", recommended.name)));
    // A sweep that takes them from records has the same.
    let again = run(folder.path(), &options(&[4, 6, 8]));
    assert!(resumed(&again).into_iter().all(|resumed| resumed));
    assert_eq!(read(&folder.path().join("sweep.html")), html);

    let csv = read(&folder.path().join("sweep.csv"));
    let rows: Vec<Vec<&str>> = csv.lines().map(|line| line.split(',').collect()).collect();
    assert_eq!(rows.len(), 1 + settings);
    assert!(rows.iter().all(|row| row.len() == rows[0].len()));
    let column = |name: &str| rows[0].iter().position(|head| *head == name).expect("a column");
    for (row, setting) in rows[1..].iter().zip(&report.settings) {
        assert_eq!(row[0], setting.name);
        assert_eq!(row[column("alpha_threshold")], "0.001");
        assert_eq!(row[column("psnr_s1")].parse(), Ok(setting.errors[1].psnr));
        assert_eq!(row[column("front_bytes_s2")], setting.fronts[0].bytes.to_string());
    }
    let json: serde_json::Value =
        serde_json::from_str(&read(&folder.path().join("sweep.json"))).expect("JSON");
    assert_eq!(json, serde_json::to_value(&again).expect("JSON"));
}

#[test]
fn filters_differ_in_shape_and_colour() {
    let folder = folder();
    let mut options = options(&[6]);
    let grid = Grid::default().with("filter", &["code", "paper"]).with("bits", &["6"]);
    options.settings = grid.settings().expect("values");
    let words: Vec<_> = options.settings.iter().filter_map(|s| s.words.clone()).collect();
    assert_eq!(words[0], ["--filter", "code", "--bits", "6"]);
    options.settings[0].command = Some("mipvog-bake bake 'a b' <&".to_owned());
    run(folder.path(), &options);
    let html = read(&folder.path().join("sweep.html"));
    assert_balanced(&html);
    let legend = html.split("class=\"legend\"").nth(1).expect("a legend");
    let legend = legend.split("</ul>").next().expect("its end");
    let shapes: Vec<&str> =
        legend.split(" d=\"").skip(1).filter_map(|rest| rest.split('"').next()).collect();
    assert_eq!(shapes.len(), 2);
    assert_ne!(shapes[0], shapes[1]);
    assert!(legend.contains("code") && legend.contains("paper"));
    assert!(html.contains("class=\"series0") && html.contains("class=\"series1"));
    // The command can be copied as it stands.
    assert!(html.contains("<code>mipvog-bake bake &#39;a b&#39; &lt;&amp;</code>"));
}

/// Every element is closed, in order.
fn assert_balanced(html: &str) {
    let mut open = Vec::new();
    for part in html.split('<').skip(1) {
        let tag = part.split('>').next().expect("a tag's end");
        if tag.starts_with('!') || tag.ends_with('/') {
            continue;
        }
        match tag.strip_prefix('/') {
            Some(name) => assert_eq!(open.pop(), Some(name)),
            None => open.push(tag.split_whitespace().next().expect("a name")),
        }
    }
    assert!(open.is_empty(), "{open:?}");
}

/// Counts the progress reports.
#[derive(Default)]
struct Counts {
    begun: AtomicU64,
    total: AtomicU64,
    steps: AtomicU64,
    others: AtomicU64,
    parts: Mutex<Vec<String>>,
}

impl Progress for Counts {
    fn begin(&self, _: Step, total: u64) {
        self.begun.fetch_add(1, Ordering::Relaxed);
        self.total.fetch_add(total, Ordering::Relaxed);
    }

    fn advance(&self, step: Step, by: u64) {
        let count = if step == Step::Sweep { &self.steps } else { &self.others };
        count.fetch_add(by, Ordering::Relaxed);
    }

    fn part(&self, step: Step, name: &str) {
        if step == Step::Sweep {
            self.parts.lock().expect("no panic").push(name.to_owned());
        }
    }
}

#[test]
fn progress_is_one_bar_that_ends_full() {
    let folder = folder();
    let (source, counts) = (tiny(), Counts::default());
    let cameras = cameras(&source, 2);
    sweep(&source, &cameras, &options(&[6, 8]), folder.path(), &counts).expect("a sweep");
    assert_eq!(counts.begun.load(Ordering::Relaxed), 1);
    assert_eq!(counts.others.load(Ordering::Relaxed), 0);
    // Tiles: two references of two; two settings, each two cameras at two scales, and a bake that
    // counts as much.
    assert_eq!(counts.total.load(Ordering::Relaxed), 2 * 2 + 2 * (2 * (2 + 1) * 2));
    assert_eq!(counts.steps.load(Ordering::Relaxed), counts.total.load(Ordering::Relaxed));
    let parts = [
        "setting 1 of 2: rate-tent-6bit-t1e-3-b8-z1",
        "setting 2 of 2: rate-tent-8bit-t1e-3-b8-z1",
    ];
    assert_eq!(*counts.parts.lock().expect("no panic"), parts);
}

#[test]
fn pictures_that_are_kept_are_made_once() {
    let source = tiny();
    let limits = Limits::default();
    let field = || Renderer::trained(&source.field, None, &limits).expect("a field");
    let (reference, cameras) = (Reference::Field(Box::new(field())), cameras(&source, 3));
    let renders = |references: &mut References| {
        let counts = Counts::default();
        let errors = references.compare(&field(), &counts, |_| Ok(())).expect("compared");
        (counts.others.load(Ordering::Relaxed), errors)
    };
    let mut kept = References::new(&reference, &cameras, &[1, 2], 1).keep(&limits);
    let mut forgotten = References::new(&reference, &cameras, &[1, 2], 1);
    let first = renders(&mut kept);
    // Tiles: a reference has two, the field's pictures two and one.
    assert_eq!(first.0, 3 * (2 + 2 + 1));
    assert_eq!(renders(&mut kept), (3 * (2 + 1), first.1.clone()));
    assert_eq!(renders(&mut forgotten), first);
    assert_eq!(renders(&mut forgotten), first);
}

#[test]
fn shards_share_a_sweep_and_a_merge_tells_of_all() {
    let folder = folder();
    let shared = folder.path().join("sweep");
    let mut share = options(&[6, 7, 8]);
    let shard = |text: &str| Share::Shard(text.parse().expect("a shard"));
    share.share = shard("0/2");
    let first = run(&shared, &share);
    let names = |report: &SweepReport| -> Vec<String> {
        report.settings.iter().map(|setting| setting.name.clone()).collect()
    };
    let all: Vec<String> = share.settings.iter().map(|setting| setting.name.clone()).collect();
    assert_eq!(names(&first), [all[0].clone(), all[2].clone()]);
    assert!(!shared.join("sweep.json").exists(), "a shard writes no report");

    // A merge bakes nothing, and says what is missing.
    share.share = Share::Merge;
    let early = run(&shared, &share);
    assert_eq!(resumed(&early), [true; 3]);
    assert!(early.settings[1].failure.is_some() && early.settings[0].failure.is_none());
    assert!(!shared.join(&early.settings[1].file).exists());

    share.share = shard("1/2");
    assert_eq!(names(&run(&shared, &share)), [all[1].clone()]);
    share.share = Share::Merge;
    let merged = run(&shared, &share);
    assert_eq!(names(&merged), all);
    assert!(merged.settings.iter().all(|setting| setting.failure.is_none()));
    let report: serde_json::Value =
        serde_json::from_str(&read(&shared.join("sweep.json"))).expect("a report");
    assert_schema("sweep", &report);
    for setting in &merged.settings {
        assert_eq!(setting.errors.len(), 2);
        assert!(shared.join(&setting.file).is_file());
    }
}
