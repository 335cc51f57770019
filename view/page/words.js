// Every word a reader sees; a language is one more entry. {n} is filled in.

export const LANGUAGES = { en: "English", de: "Deutsch", ja: "日本語" };

const WORDS = {
  en: {
    play: "Play", pause: "Pause", back: "One generation back", step: "One generation on", first: "To the start",
    last: "To the end", speed: "Speed", perSecond: "{n} / s", timeline: "Generation", stage: "Stage", stageOf: "Stage {n} of {m}",
    generation: "Generation {g} of {n}", running: "Generation {g} of {n} …", language: "Language", theme: "Light or dark",
    runnable: "runs in this page", recorded: "a recorded run", live: "live from Python", gone: "Python is no longer there.", changed: "changed in this page",
    tabs: "Panels", rule: "Rule", look: "Look", draw: "Draw", about: "About", agent: "Agent", charts: "Charts", save: "Save", tries: "Try",
    colour: "Colours show", taken: "load taken so far", now: "load taken now", spawn: "generation of waking", kept: "load kept",
    stress: "pressure", move: "displacement", deformed: "Deformed shape", magnified: "magnified {n} times", magnify: "Magnification",
    arrows: "Loads on their way", path: "Load path", beside: "Elastic answer beside it", error: "Difference between the two",
    cut: "Cut plane", cutAt: "Cut at", none: "none", only: "Only agents that are awake", turn: "Drag to turn the body.",
    alpha1: "α₁ kept", alpha2: "α₂ passed ahead", alpha3: "α₃ to each side", beta: "β free widening", nu: "ν Poisson's ratio", modulus: "E stiffness",
    gamma: "γ threshold", accumulate: "Add up loads that meet", sense: "Tell pushes from pulls", load: "Load", loadFactor: "Load ×", material: "Material",
    inspect: "Look and drag loads", pen: "Mouse", penMaterial: "Draw {name}", air: "Draw air", rigid: "Draw rigid", hold: "Held sides",
    left: "left", right: "right", bottom: "bottom", top: "top", front: "front", 
    free: "free", rigidSide: "rigid", roller: "roller", reset: "As it was", resetHint: "Everything as it was at first",
    agents: "agents awake", onTheWay: "load on its way", largest: "largest load", residual: "left unbalanced", ledger: "taken / ended in all",
    asItWas: "As it was", tryAdd: "Add up what meets", tryWalk: "No sideways push (β = 1)", tryFine: "A finer threshold (γ / 10)", tryBlow: "Make it blow up",
    pick: "Click a cell to read its story.", asleep: "No agent here: no load above γ has arrived.",
    isAir: "Air: a free boundary.", isRigid: "Rigid: gives loads back, reversed.", isRoller: "A roller.", cellOf: "Cell {c}", woken: "Woken", byWhom: "in generation {g} by {w}",
    outside: "the applied load", took: "Took", keptIt: "Kept", passedOn: "Passed on", ended: "Let end", gotBack: "Got back", unknown: "not known",
    atEnd: "known at the end of the run", thisGeneration: "now", pushes: "push", pulls: "pull",
    saveScene: "Scene (TOML)", savePng: "Picture (PNG)", saveSvg: "Picture (SVG)", saveFilm: "Film (WebM)", saveCsv: "Agents (CSV)", filming: "Filming …", saved: "Saved {name}.",
    keys: "Space: play or pause · ← →: one generation · Home, End: start, end · Tab to the picture, then arrows: walk from cell to cell, Enter: draw",
    noAnswer: "No elastic answer: {why}", solving: "Solving …", elastic: "elasticity", solvedIn: "solved in {n} s",
    misfit: "The rule's largest displacement is {a}, elasticity's {b}; on average they differ by {n} % of it.",
    ends: "every load ends within {n} generations", ends1: "every load ends within 1 generation", nothing: "no load exceeds the threshold: nothing happens",
    never: "a load that an agent of '{m}' passes on in one piece is not smaller than the load it took, so it never ends: lower forward (α₂), friction (α₃) and α₁ below 1",
    grow: "loads grow by {p} % a generation", mayGrow: "loads may grow by up to {p} % a generation in '{m}'",
    lower: "{a}: lower {r}, or judge each load by itself (accumulate = false)", or: " or ", forwardBelow: "forward (α₂) below {x}", frictionBelow: "friction (α₃) below {x}", allShares: "all shares of it",
    grown: "The loads have grown beyond all bounds; the run was stopped.", network: "network", points: "points", picture: "Picture of the body. {g}. {a} agents awake.",
    time: "Time", moment: "{g} of {n}", 
    pictures: "a recorded run", pickPart: "Click a part to read its numbers.", part: "Part {n}", parents: "Parents of {n} cells act", along_step: "Step", along_generation: "Generation",
    along_stage: "Stage of loading", along_share: "Share of the load", value_tension: "pull (+) or push (−)", value_von_mises: "equivalent stress",
    value_load_taken: "load taken", value_load_left: "load left unbalanced", value_level: "level: how often halved", value_unbalanced_load: "load left unbalanced", value_spawn_step: "generation of spawning",
    undo: "Undo", redo: "Redo", copyLink: "Copy link", linkCopied: "Link copied", linkThere: "The link is in the address line.", linkBroken: "This link cannot be read: {why}", more: "More",
    views: "Ways of looking", body: "Whole body", lessons: "Lessons", sheet: "Higher or lower", forget: "Delete my answers", typed: "{name}: type a number",
    outOfRange: "Between {a} and {b}.", linear: "linear", log: "log", letters: "Keys of one letter: L, A, 1 to 4", loads: "Loads", addLoad: "Add a load", deleteLoad: "Delete this load",
    angle: "Direction", loadHint: "Drag a ring to move a load, the head to turn and strengthen it. Double-click beside the body to add one.", loadAt: "Load {n} of {m}, on {c}",
    needsCell: "A load needs a cell of the body.", takenInAll: "taken", endedInAll: "ended", answerFirst: "First answer this question.", generationOnly: "Generation {g}",
    step_predict: "Predict", step_step: "Step", step_explain: "Explain", step_try: "Try", questionOf: "Question {n} of {m} · {t} minutes", myGuess: "My guess",
    whatHappened: "What happened", both: "Both", changeGuess: "Change my guess", clearTicks: "Clear my ticks", hit: "hit", miss: "missed", false: "false", hitMeans: "ticked, awake",
    missMeans: "awake, no tick", falseMeans: "ticked, asleep", surprise: "What surprises you?", yourAnswer: "Your answer", hint: "Hint", backOne: "Back", nextStep: "Next: {step}",
    nextQuestion: "Next", savedHere: "Saved on this computer", notSaved: "This browser does not save. Print before you close.", letters_of: "{n} of {m} letters",
    asInPicture: "as in the picture", lookAgain: "look again at {x}", thePicture: "the picture", noNumber: "a number is needed", teacher: "Teacher", answers: "Answers",
    worksheet: "Worksheet", answersHidden: "answers hidden · all generations open with it", answersShown: "answers shown · all generations open", minutes: "{t} minutes", name: "Name",
    course: "Class", date: "Date", asSaved: "ticks and answers as of {d}", tickedFor: "ticked for generation {n}", notTicked: "not ticked", awakeSince: "awake since generation {n}",
    asleepNow: "asleep", cell: "The rule in one cell", comesIn: "comes in", keeps: "keeps", ahead: "ahead", along: "along, each side", outwards: "outwards, each side", ends_: "ends",
    each: "each", howMany: "how many", from: "from", loadOf: "load {n} of {m}", formerLoad: "Load before", nextLoad: "Next load", cameIn: "{c}: what came in, up to generation {g}",
    ofThisLoad: "Of this load, P = {p}", cameBack: "What came back", fromWoken: "from neighbours it woke", fromEdge: "from the edge (air, ground)",
    inAll: "In all it took {a}, kept {b} and passed on {c}.", inOut: "1 N in, {x} out: this is not a balance.", wokeIt: "woke it", theAir: "the edge (air)", theGround: "the edge (ground)",
    theRoller: "the edge (rollers)", air_: "air", ground: "ground", largestWas: "The largest was {x}, from {w}.", tooMany: "Too many loads travel here to tell them one by one.",
    ownArrows: "These arrows are sums of what the agent has passed on; its own code decides how much.", cameFrom: "came in, from",
    cellKey: "an arrow’s width is its load · dashed arrow: not above γ = {g}, it ends · dashed frame: the cell at rest",
    ruleInWords: "A cell wakes when a load P above γ arrives. It keeps α₁P, which squeezes it. It hands α₂P ahead and α₃P to each side, along the same direction. What blocks its widening pushes both neighbours outwards.",
  },
  de: {
    play: "Abspielen", pause: "Pause", back: "Eine Generation zurück", step: "Eine Generation weiter", first: "Zum Anfang",
    last: "Zum Ende", speed: "Tempo", perSecond: "{n} / s", timeline: "Generation", stage: "Stufe", stageOf: "Stufe {n} von {m}",
    generation: "Generation {g} von {n}", running: "Generation {g} von {n} …", language: "Sprache", theme: "Hell oder dunkel",
    runnable: "rechnet in dieser Seite", recorded: "ein aufgezeichneter Lauf", live: "live aus Python", gone: "Python ist nicht mehr da.", changed: "in dieser Seite geändert",
    tabs: "Tafeln", rule: "Regel", look: "Ansicht", draw: "Malen", about: "Worum es geht", agent: "Agent", charts: "Kurven", save: "Sichern", tries: "Versuche",
    colour: "Farben zeigen", taken: "bisher aufgenommene Last", now: "jetzt aufgenommene Last", spawn: "Generation des Erwachens", kept: "behaltene Last",
    stress: "Druck", move: "Verschiebung", deformed: "Verformte Gestalt", magnified: "{n}-fach vergrößert", magnify: "Vergrößerung",
    arrows: "Lasten unterwegs", path: "Lastpfad", beside: "Elastische Lösung daneben", error: "Unterschied der beiden",
    cut: "Schnittebene", cutAt: "Schnitt bei", none: "keine", only: "Nur wache Agenten", turn: "Ziehen dreht den Körper.",
    alpha1: "α₁ behalten", alpha2: "α₂ nach vorn", alpha3: "α₃ je Seite", beta: "β freie Dehnung", nu: "ν Querdehnzahl", modulus: "E Steifigkeit",
    gamma: "γ Schwelle", accumulate: "Zusammentreffende Lasten addieren", sense: "Druck und Zug unterscheiden", load: "Last", loadFactor: "Last ×", material: "Material",
    inspect: "Ansehen und Lasten ziehen", pen: "Maus", penMaterial: "{name} malen", air: "Luft malen", rigid: "Starres malen", hold: "Gehaltene Seiten",
    left: "links", right: "rechts", bottom: "unten", top: "oben", front: "vorn", 
    free: "frei", rigidSide: "starr", roller: "Rollen", reset: "Wie zuvor", resetHint: "Alles wie am Anfang",
    agents: "wache Agenten", onTheWay: "Last unterwegs", largest: "größte Last", residual: "nicht ausgeglichen", ledger: "aufgenommen / geendet",
    asItWas: "Wie zuvor", tryAdd: "Treffende Lasten addieren", tryWalk: "Kein Querdruck (β = 1)", tryFine: "Feinere Schwelle (γ / 10)", tryBlow: "Aufschaukeln",
    pick: "Eine Zelle anklicken, um ihre Geschichte zu lesen.", asleep: "Kein Agent: Es kam keine Last über γ an.",
    isAir: "Luft: ein freier Rand.", isRigid: "Starr: gibt Lasten umgekehrt zurück.", isRoller: "Eine Rolle.", cellOf: "Zelle {c}", woken: "Geweckt", byWhom: "in Generation {g} von {w}",
    outside: "der angelegten Last", took: "Nahm auf", keptIt: "Behielt", passedOn: "Gab weiter", ended: "Ließ enden", gotBack: "Bekam zurück", unknown: "nicht bekannt",
    atEnd: "am Ende des Laufs bekannt", thisGeneration: "jetzt", pushes: "Druck", pulls: "Zug",
    saveScene: "Szene (TOML)", savePng: "Bild (PNG)", saveSvg: "Bild (SVG)", saveFilm: "Film (WebM)", saveCsv: "Agenten (CSV)", filming: "Wird gefilmt …", saved: "{name} gesichert.",
    keys: "Leertaste: abspielen oder anhalten · ← →: eine Generation · Pos1, Ende: Anfang, Ende · Tabulator zum Bild, dann Pfeile: von Zelle zu Zelle, Eingabe: malen",
    noAnswer: "Keine elastische Lösung: {why}", solving: "Wird gelöst …", elastic: "Elastizität", solvedIn: "gelöst in {n} s",
    misfit: "Größte Verschiebung: Regel {a}, Elastizität {b}; im Mittel weichen sie um {n} % davon ab.",
    ends: "jede Last endet in höchstens {n} Generationen", ends1: "jede Last endet in höchstens einer Generation", nothing: "keine Last überschreitet die Schwelle: es geschieht nichts",
    never: "eine Last, die ein Agent aus '{m}' in einem Stück weitergibt, ist nicht kleiner als die aufgenommene und endet daher nie: α₂, α₃ und α₁ unter 1 senken",
    grow: "Lasten wachsen um {p} % je Generation", mayGrow: "Lasten wachsen in '{m}' um bis zu {p} % je Generation",
    lower: "{a}: {r} senken oder jede Last einzeln beurteilen", or: " oder ", forwardBelow: "α₂ (nach vorn) unter {x}", frictionBelow: "α₃ (je Seite) unter {x}", allShares: "alle Anteile",
    grown: "Die Lasten sind über alle Grenzen gewachsen; der Lauf wurde angehalten.", network: "Netzwerk", points: "Punkte", picture: "Bild des Körpers. {g}. {a} wache Agenten.",
    time: "Zeit", moment: "{g} von {n}", 
    pictures: "ein aufgezeichneter Lauf", pickPart: "Ein Teil anklicken, um seine Zahlen zu lesen.", part: "Teil {n}", parents: "Eltern von {n} Zellen handeln", along_step: "Schritt", along_generation: "Generation",
    along_stage: "Laststufe", along_share: "Anteil der Last", value_tension: "Zug (+) oder Druck (−)", value_von_mises: "Vergleichsspannung",
    value_load_taken: "aufgenommene Last", value_load_left: "nicht ausgeglichene Last", value_level: "Stufe: wie oft halbiert", value_unbalanced_load: "nicht ausgeglichene Last", value_spawn_step: "Generation der Entstehung",
    undo: "Rückgängig", redo: "Wiederholen", copyLink: "Link kopieren", linkCopied: "Link kopiert", linkThere: "Der Link steht in der Adresszeile.",
    linkBroken: "Dieser Link ist nicht lesbar: {why}", more: "Mehr", views: "Ansichten", body: "Ganzer Körper", lessons: "Stunden", sheet: "Höher oder tiefer",
    forget: "Meine Antworten löschen", typed: "{name}: Zahl eingeben", outOfRange: "Zwischen {a} und {b}.", linear: "linear", log: "logarithmisch",
    letters: "Tasten mit einem Buchstaben: L, A, 1 bis 4", loads: "Lasten", addLoad: "Last hinzufügen", deleteLoad: "Diese Last löschen", angle: "Richtung",
    loadHint: "Am Ring ziehen verschiebt eine Last, an der Spitze ziehen dreht und verstärkt sie. Doppelklick neben dem Körper fügt eine hinzu.", loadAt: "Last {n} von {m}, auf {c}",
    needsCell: "Eine Last braucht eine Zelle des Körpers.", takenInAll: "aufgenommen", endedInAll: "geendet", answerFirst: "Beantworte erst diese Frage.", generationOnly: "Generation {g}",
    step_predict: "Vermuten", step_step: "Verfolgen", step_explain: "Erklären", step_try: "Probieren", questionOf: "Frage {n} von {m} · {t} Minuten", myGuess: "Meine Vermutung",
    whatHappened: "Was geschah", both: "Beides", changeGuess: "Vermutung ändern", clearTicks: "Kreuze löschen", hit: "Treffer", miss: "übersehen", false: "daneben",
    hitMeans: "angekreuzt, wach", missMeans: "wach, kein Kreuz", falseMeans: "angekreuzt, schläft", surprise: "Was überrascht dich?", yourAnswer: "Deine Antwort", hint: "Tipp",
    backOne: "Zurück", nextStep: "Weiter: {step}", nextQuestion: "Weiter", savedHere: "Auf diesem Computer gesichert", notSaved: "Dieser Browser sichert nichts. Vor dem Schließen drucken.",
    letters_of: "{n} von {m} Zeichen", asInPicture: "wie im Bild", lookAgain: "schau noch einmal auf {x}", thePicture: "das Bild", noNumber: "eine Zahl ist gefragt", teacher: "Lehrkraft",
    answers: "Antworten", worksheet: "Arbeitsblatt", answersHidden: "Antworten verborgen · öffnet auch alle Generationen", answersShown: "Antworten sichtbar · alle Generationen offen",
    minutes: "{t} Minuten", name: "Name", course: "Klasse", date: "Datum", asSaved: "Kreuze und Antworten vom {d}", tickedFor: "angekreuzt für Generation {n}", notTicked: "kein Kreuz",
    awakeSince: "wach seit Generation {n}", asleepNow: "schläft", cell: "Die Regel in einer Zelle", comesIn: "kommt an", keeps: "behält", ahead: "nach vorn", along: "mit, je Seite",
    outwards: "nach außen, je Seite", ends_: "endet", each: "je", howMany: "wie oft", from: "von", loadOf: "Last {n} von {m}", formerLoad: "Vorige Last", nextLoad: "Nächste Last",
    cameIn: "{c}: was ankam, bis Generation {g}", ofThisLoad: "Von dieser Last, P = {p}", cameBack: "Was zurückkam", fromWoken: "von geweckten Nachbarn", fromEdge: "vom Rand (Luft, Boden)",
    inAll: "Insgesamt nahm sie {a} auf, behielt {b} und gab {c} weiter.", inOut: "1 N hinein, {x} hinaus: kein Gleichgewicht.", wokeIt: "weckte sie", theAir: "dem Rand (Luft)",
    theGround: "dem Rand (Boden)", theRoller: "dem Rand (Rollen)", air_: "Luft", ground: "Boden", largestWas: "Die größte war {x}, von {w}.",
    tooMany: "Hier sind zu viele Lasten unterwegs, um sie einzeln zu nennen.", ownArrows: "Die Pfeile sind Summen dessen, was der Agent weitergab; wie viel, bestimmt sein eigener Code.",
    cameFrom: "kam an, von", cellKey: "Breite des Pfeils: seine Last · gestrichelter Pfeil: nicht über γ = {g}, endet · gestrichelter Rahmen: die Zelle in Ruhe",
    ruleInWords: "Eine Zelle erwacht, wenn eine Last P über γ ankommt. Sie behält α₁P, das sie staucht. Sie gibt α₂P nach vorn und α₃P an jede Seite, in derselben Richtung. Was ihre Verbreiterung hemmt, drückt beide Nachbarn nach außen.",
  },
  ja: {
    play: "再生", pause: "一時停止", back: "一世代もどる", step: "一世代すすむ", first: "はじめへ",
    last: "おわりへ", speed: "速さ", perSecond: "{n} / s", timeline: "世代", stage: "段階", stageOf: "段階 {n} / {m}",
    generation: "世代 {g} / {n}", running: "世代 {g} / {n} …", language: "言語", theme: "明るい / 暗い",
    runnable: "このページで計算", recorded: "記録された計算", live: "Python から実況", gone: "Python との接続が切れました。", changed: "このページで変更",
    tabs: "パネル", rule: "規則", look: "表示", draw: "描く", about: "説明", agent: "エージェント", charts: "グラフ", save: "保存", tries: "試す",
    colour: "色が示すもの", taken: "これまでに受けた荷重", now: "いま受けた荷重", spawn: "目覚めた世代", kept: "保持した荷重",
    stress: "圧力", move: "変位", deformed: "変形した形", magnified: "{n} 倍に拡大", magnify: "拡大率",
    arrows: "移動中の荷重", path: "荷重の経路", beside: "弾性解を並べる", error: "両者の差",
    cut: "断面", cutAt: "断面の位置", none: "なし", only: "目覚めたエージェントのみ", turn: "ドラッグで物体を回します。",
    alpha1: "α₁ 保持", alpha2: "α₂ 前へ", alpha3: "α₃ 両横へ", beta: "β 自由な膨張", nu: "ν ポアソン比", modulus: "E 剛性",
    gamma: "γ しきい値", accumulate: "出会った荷重を足す", sense: "押しと引きを区別", load: "荷重", loadFactor: "荷重 ×", material: "材料",
    inspect: "見る・荷重を動かす", pen: "マウス", penMaterial: "{name} を描く", air: "空気を描く", rigid: "剛体を描く", hold: "辺の支え",
    left: "左", right: "右", bottom: "下", top: "上", front: "手前", 
    free: "自由", rigidSide: "固定", roller: "ローラー", reset: "もとに戻す", resetHint: "すべてはじめの状態に戻す",
    agents: "目覚めた数", onTheWay: "移動中の荷重", largest: "最大の荷重", residual: "残りの不釣合い", ledger: "受けた / 消えた合計",
    asItWas: "もとのまま", tryAdd: "出会う荷重を足す", tryWalk: "横押しなし (β = 1)", tryFine: "細かいしきい値 (γ / 10)", tryBlow: "発散させる",
    pick: "セルをクリックすると経緯が読めます。", asleep: "エージェントなし：γ を超える荷重は届いていません。",
    isAir: "空気：自由な境界。", isRigid: "剛体：荷重を逆向きに返します。", isRoller: "ローラー。", cellOf: "セル {c}", woken: "目覚め", byWhom: "世代 {g}、{w} による",
    outside: "加えた荷重", took: "受けた", keptIt: "保持", passedOn: "渡した", ended: "消えた", gotBack: "戻された", unknown: "不明",
    atEnd: "計算の終わりに分かります", thisGeneration: "いま", pushes: "押し", pulls: "引き",
    saveScene: "シーン (TOML)", savePng: "画像 (PNG)", saveSvg: "画像 (SVG)", saveFilm: "動画 (WebM)", saveCsv: "エージェント (CSV)", filming: "録画中 …", saved: "{name} を保存しました。",
    keys: "スペース：再生・停止 · ← →：一世代 · Home, End：はじめ・おわり · Tab で画像へ、矢印でセルを移動、Enter で描く",
    noAnswer: "弾性解はありません：{why}", solving: "計算中 …", elastic: "弾性", solvedIn: "{n} 秒で計算",
    misfit: "最大変位：規則 {a}、弾性 {b}。平均の差はその {n} %。",
    ends: "すべての荷重は {n} 世代以内に消えます", ends1: "すべての荷重は 1 世代以内に消えます", nothing: "しきい値を超える荷重がなく、何も起こりません",
    never: "「{m}」のエージェントが一つのまま渡す荷重は受けた荷重より小さくならず、消えません：α₂・α₃・α₁ を 1 より小さくしてください",
    grow: "荷重は一世代ごとに {p} % 増えます", mayGrow: "「{m}」で荷重は一世代ごとに最大 {p} % 増えます",
    lower: "{a}：{r}にするか、荷重を一つずつ判定してください", or: "、または ", forwardBelow: "前へ (α₂) を {x} 未満", frictionBelow: "横へ (α₃) を {x} 未満", allShares: "すべての割合を小さく",
    grown: "荷重が際限なく増えたため、計算を止めました。", network: "ネットワーク", points: "点", picture: "物体の図。{g}。目覚めたエージェント {a}。",
    time: "時間", moment: "{g} / {n}", 
    pictures: "記録された計算", pickPart: "部分をクリックすると数値が読めます。", part: "部分 {n}", parents: "{n} セルの親が働く", along_step: "ステップ", along_generation: "世代",
    along_stage: "載荷段階", along_share: "荷重の割合", value_tension: "引き (+)・押し (−)", value_von_mises: "相当応力",
    value_load_taken: "受けた荷重", value_load_left: "残りの不釣合い荷重", value_level: "階層：半分にした回数", value_unbalanced_load: "残りの不釣合い荷重", value_spawn_step: "生まれた世代",
    undo: "元に戻す", redo: "やり直す", copyLink: "リンクをコピー", linkCopied: "コピーしました", linkThere: "リンクはアドレス欄にあります。", linkBroken: "このリンクは読めません：{why}", more: "その他", views: "見方", body: "全体",
    lessons: "授業一覧", sheet: "高さを変える", forget: "自分の答えを消す", typed: "{name}：数値を入力", outOfRange: "{a} から {b} まで。", linear: "線形", log: "対数", letters: "一文字のキー：L、A、1〜4", loads: "荷重",
    addLoad: "荷重を加える", deleteLoad: "この荷重を消す", angle: "向き", loadHint: "輪をドラッグすると荷重が動き、矢の先をドラッグすると向きと強さが変わります。物体の横をダブルクリックすると荷重が加わります。", loadAt: "荷重 {n} / {m}、{c}",
    needsCell: "荷重には物体のセルが必要です。", takenInAll: "受けた", endedInAll: "消えた", answerFirst: "まずこの問いに答えてください。", generationOnly: "世代 {g}", step_predict: "予想", step_step: "進める", step_explain: "説明",
    step_try: "試す", questionOf: "問 {n} / {m} · {t} 分", myGuess: "自分の予想", whatHappened: "実際", both: "両方", changeGuess: "予想を変える", clearTicks: "印を消す", hit: "当たり", miss: "見落とし", false: "はずれ",
    hitMeans: "印あり・目覚めた", missMeans: "印なし・目覚めた", falseMeans: "印あり・眠っている", surprise: "意外だったことは？", yourAnswer: "あなたの答え", hint: "ヒント", backOne: "もどる", nextStep: "次へ：{step}",
    nextQuestion: "次へ", savedHere: "この端末に保存しました", notSaved: "このブラウザーは保存できません。閉じる前に印刷してください。", letters_of: "{n} / {m} 文字", asInPicture: "図のとおり", lookAgain: "{x}をもう一度", thePicture: "図",
    noNumber: "数値を入れてください", teacher: "先生", answers: "解答", worksheet: "ワークシート", answersHidden: "解答は隠れています · すべての世代も開きます", answersShown: "解答を表示 · すべての世代が開いています", minutes: "{t} 分", name: "名前",
    course: "組", date: "日付", asSaved: "印と答え：{d}", tickedFor: "世代 {n} に印", notTicked: "印なし", awakeSince: "世代 {n} から目覚めている", asleepNow: "眠っている", cell: "一つのセルの規則", comesIn: "入る", keeps: "保持",
    ahead: "前へ", along: "同じ向きに両横へ", outwards: "外向きに両横へ", ends_: "消える", each: "大きさ", howMany: "回数", from: "どこから", loadOf: "荷重 {n} / {m}", formerLoad: "前の荷重", nextLoad: "次の荷重",
    cameIn: "{c}：世代 {g} までに入ってきたもの", ofThisLoad: "この荷重 P = {p} のうち", cameBack: "戻ってきたもの", fromWoken: "起こした隣から", fromEdge: "境界から（空気・地面）", inAll: "合計 {a} を受け、{b} を保持し、{c} を渡しました。",
    inOut: "1 N 入り {x} 出る：つり合っていません。", wokeIt: "起こした", theAir: "境界（空気）", theGround: "境界（地面）", theRoller: "境界（ローラー）", air_: "空気", ground: "地面", largestWas: "最大は {w} からの {x} でした。",
    tooMany: "荷重が多すぎて一つずつ示せません。", ownArrows: "矢印はエージェントが渡したものの合計です。量はそのコードが決めます。", cameFrom: "入った：", cellKey: "矢の太さは荷重 · 破線の矢：γ = {g} 以下で消える · 破線の枠：もとのセル",
    ruleInWords: "γ を超える荷重 P が届くとセルは目覚めます。α₁P を保持して縮み、α₂P を前へ、α₃P を同じ向きに両横へ渡します。妨げられた膨張は両隣を外へ押します。",
  },
};

export const say = (language) => (key, values = {}) => {
  const text = WORDS[language]?.[key] ?? WORDS.en[key];
  if (text === undefined) throw new Error(`no word for ${key}`);
  return text.replace(/\{(\w+)\}/g, (_, name) => values[name]);
};
export const catalogue = () => WORDS;
/** Words of a module of its own, in every language. */
export function addWords(more) { for (const language in more) Object.assign(WORDS[language], more[language]); }

// ------------------------------------------------------------------------------------ numbers

/** A number with so many significant digits, as Python's format code "g" writes it. */
export function general(x, digits) {
  if (x === 0) return "0";
  const [mantissa, exponent] = x.toExponential(digits - 1).split("e"), e = Number(exponent);
  const plain = (text) => (text.includes(".") ? text.replace(/\.?0+$/, "") : text);
  if (e < -4 || e >= digits) return `${plain(mantissa)}e${e < 0 ? "-" : "+"}${String(Math.abs(e)).padStart(2, "0")}`;
  return plain(x.toFixed(Math.max(0, digits - 1 - e)));
}

export const PREFIXES = [[1e9, "G"], [1e6, "M"], [1e3, "k"], [1, ""], [1e-3, "m"], [1e-6, "µ"], [1e-9, "n"], [1e-12, "p"]];

/** Four digits and a unit that fits: 12.88 N, 3.2 nm, 206 GPa. */
export function quantity(v, unit) {
  if (!Number.isFinite(v)) return "–";
  const sign = v < 0 ? "−" : "", size = Math.abs(v);
  if (!unit) return sign + (size >= 1e5 || (size && size < 1e-3) ? power(size) : general(size, 4));
  if (size === 0) return `0 ${unit}`;
  const [factor, prefix] = PREFIXES.find(([f]) => size >= 0.99995 * f) ?? PREFIXES.at(-1);
  const shown = size / factor;
  return `${sign}${shown >= 1e4 || shown < 1e-2 ? power(shown) : general(shown, 4)} ${prefix}${unit}`;
}
const power = (x) => x.toExponential(2).replace(/e\+?(-?)(\d+)/, (_, s, n) => ` × 10${s ? "⁻" : ""}${[...n].map((c) => "⁰¹²³⁴⁵⁶⁷⁸⁹"[c]).join("")}`);

/** The certificate in words: in English those of kaju.stability. */
export function verdictOf(certificate, rule, t) {
  const { generations: n, name: m } = certificate;
  if (n !== null) return n === 0 ? t("nothing") : n === 1 ? t("ends1") : t("ends", { n });
  if (!rule.accumulate) return t("never", { m });
  const a = certificate.lower < 1 ? t("mayGrow", { m, p: general(100 * (certificate.upper - 1), 3) })
    : t("grow", { p: general(100 * (certificate.lower - 1), 3) });
  const remedies = [["forwardBelow", certificate.forward], ["frictionBelow", certificate.friction]]
    .filter(([, limit]) => limit > 0).map(([word, limit]) => t(word, { x: general(limit, 4) }));
  return t("lower", { a, r: remedies.length ? remedies.join(t("or")) : t("allShares") });
}
