import "./style/theme.css";
import "./style/layout.css";
import "./style/parts.css";
import "./style/small.css";

import { effect } from "@preact/signals";
import { render } from "preact";

import { Api } from "./api";
import type { App } from "./app";
import { Address, wantedMap } from "./chrome/address";
import { Dialogs } from "./chrome/dialogs";
import { Head, isSignInOpen } from "./chrome/head";
import { startKeys } from "./chrome/keys";
import { startNotifying } from "./chrome/notifying";
import { announce, Notices } from "./chrome/notices";
import { NoGraphics, StageChrome } from "./chrome/stage_chrome";
import { sayShell } from "./chrome/shell";
import { startPulling, startSide } from "./chrome/side";
import { startTellingEvents } from "./chrome/telling";
import { Tabs } from "./chrome/tabs";
import { startTheme, theme } from "./chrome/theme";
import { mount as mountEvents } from "./events/mount";
import { mount as mountDetails } from "./details/mount";
import { mount as mountEdit } from "./edit/mount";
import { startHeat } from "./heat/reader";
import { mount as mountImport } from "./importing/mount";
import { mount as mountQueries } from "./queries/mount";
import { mount as mountRules } from "./rules/mount";
import { Stage } from "./scene/stage";
import { Showing } from "./showing";
import { State } from "./state";
import { Timeline } from "./timeline/timeline";
import { askAgain } from "./unanswered";

function start(): void {
  sayShell();
  startTheme();
  const api = new Api();
  const state = new State();
  const showing = new Showing(api, state, announce);
  const part = (id: string): HTMLElement => document.getElementById(id)!;
  if (document.createElement("canvas").getContext("webgl2") === null) {
    render(<NoGraphics />, part("stage-chrome"));
    return;
  }
  const stage = new Stage(part("stage"), state, showing.now);
  const timeline = new Timeline(state, showing);
  const app: App = {
    api,
    state,
    surface: stage,
    timeline,
    announce,
    reloadMap: () => showing.reloadMap(),
    reloadMaps: (show) => showing.reloadMaps(show),
    moveTo: (at) => {
      showing.pause();
      showing.moveTo(at);
      if (at !== null) timeline.reveal(at);
    },
  };
  api.onUnauthorised = (problem) => {
    if (state.unauthorised.value === null) isSignInOpen.value = true;
    state.unauthorised.value = problem;
  };
  const signedIn = async (): Promise<void> => {
    state.unauthorised.value = null;
    await showing.reloadMaps(wantedMap());
    if (state.unauthorised.value !== null) return;
    isSignInOpen.value = false;
    askAgain();
  };

  const address = new Address(app, showing, stage);
  render(<Head app={app} showing={showing} copyLink={() => void address.copy()} />, part("head"));
  render(<Tabs state={state} />, part("tabs"));
  render(<StageChrome app={app} showing={showing} stage={stage} />, part("stage-chrome"));
  render(<Dialogs app={app} signedIn={() => void signedIn()} />, part("dialogs"));
  render(<Notices />, part("notices"));
  timeline.mount(part("time"), app);
  mountDetails(part("panel-details"), app, showing);
  mountEvents(part("panel-events"), app);
  mountEdit(part("panel-edit"), app);
  mountRules(part("panel-rules"), app);
  mountQueries(part("panel-queries"), app);
  mountImport(part("panel-import"), app);

  startSide(state);
  startPulling(part("tabs"));
  effect(() => {
    void theme.value;
    stage.recolour();
  });
  startKeys(app, showing, stage);
  startTellingEvents(state);
  startNotifying(app);
  startHeat(app);
  showing.showOn(stage);
  address.start();
  void showing.reloadMaps(wantedMap());
}

start();
